#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""packing.py BIN_DIR: scripts/bridges/pack.py with our C library and without it: the same blocks."""
import contextlib
import pathlib
import struct
import tempfile
import unittest
from unittest import mock

import _ctypes  # any shared object that is not ours
import testing
from testing import Client, Program, crc32c, np

import bridge
import pack

library = pack.library


def without_library():
    """As where it is absent."""
    stack = contextlib.ExitStack()
    stack.enter_context(mock.patch.object(pack, "library", None))
    stack.enter_context(mock.patch.object(pack, "crc32c", crc32c, create=True))
    return stack


def some_tags(size, kind=None):
    """Any bytes, but starts and overflows are not rare."""
    tags = np.random.default_rng(size).integers(0, 256, 16 * size, "u1").view(pack.RECORD)
    tags["type"] %= 8
    tags["channel"] %= 4
    if kind is None:
        return tags
    copy = np.zeros(size, kind)
    for name in tags.dtype.names:
        copy[name] = tags[name]
    return copy


class Packing(unittest.TestCase):
    def both(self, tags):
        with without_library():
            slow = pack.pack(tags, (2, 3))
        fast = pack.pack(tags, (2, 3))
        self.assertEqual([bytes(b.payload) for b in fast], [bytes(b.payload) for b in slow])
        self.assertEqual([b[1::2] for b in fast], [b[1::2] for b in slow])  # items, starts
        self.assertEqual([b.overflows for b in fast], [b.overflows for b in slow])
        self.assertEqual([b.crc for b in fast], [crc32c.crc32c(bytes(b.payload)) for b in slow])
        return fast

    def setUp(self):
        if library is None:
            self.skipTest(f"{pack.why_not} (not built, or with a sanitizer)")

    def test_sizes(self):
        for size in (0, 1, 2, 1535, 1536, 1537, pack.BLOCK_TAGS, pack.BLOCK_TAGS + 1, 150_000):
            tags = some_tags(size)
            blocks = self.both(tags)
            tags = tags[np.isin(tags["channel"], (2, 3)) | np.isin(tags["type"], (1, 2, 3))]  # what is not ours is dropped
            self.assertEqual(sum(b.items for b in blocks), len(tags))
            packed = np.frombuffer(b"".join(b.payload for b in blocks), pack.RECORD)
            for name in packed.dtype.names:
                np.testing.assert_array_equal(packed[name], tags[name])
            self.assertFalse(packed.view("u1")[1::16].any())  # the reserved byte, whatever it was
            self.assertEqual(sum(b.starts for b in blocks), np.count_nonzero(tags["channel"] == 2))
            self.assertEqual(sum(b.overflows for b in blocks), np.count_nonzero(tags["type"] == 2))

    def test_layouts(self):
        """Bytes apart, another order and other types, and bytes that nobody may write to."""
        self.both(some_tags(10_000)[::3])
        self.both(some_tags(1000, [("time", "i8"), ("type", "u4"), ("channel", "i4"), ("missed_events", "u4")]))
        tags = some_tags(1000)
        tags.flags.writeable = False
        self.both(tags)

    def test_the_librarys_memory_may_change(self):
        for scope in (contextlib.nullcontext(), without_library()):
            with scope:
                tags = some_tags(100)
                block, = pack.pack(tags, (1, 2))
                before = bytes(block.payload)
                tags.view("u1")[:] = 0xEE
                self.assertEqual(bytes(block.payload), before)

    def test_checksums_of_blocks(self):
        for size in (0, 1, 31, 100_000):
            payload = bytes(range(256)) * (size // 256) + bytes(size % 256)
            with without_library():
                header = bridge.block(1, 7, payload, 3)
            self.assertEqual(bridge.block(1, 7, payload, 3), header)
            self.assertEqual(bridge.block(1, 7, payload, 3, crc32c.crc32c(payload)), header)
            self.assertEqual(struct.unpack("<I", header[28:])[0], crc32c.crc32c(header[:28] + payload))


class Absent(unittest.TestCase):
    def test_told_in_one_line_and_served(self):
        with tempfile.TemporaryDirectory() as folder:
            text = pathlib.Path(folder) / "text.so"
            text.write_text("no library")
            for named, why in (("", "is not there"), (str(text), "does not serve"), (_ctypes.__file__, "does not serve")):
                with self.subTest(named), Program("timetagger.py", ECHOFUSE_BRIDGE_LIBRARY=named) as program:
                    with Client(program.address) as client:
                        client.until(bridge.TAGS)  # checks the CRCs
                    self.assertEqual(program.stop(), 0)
                    told = [line for line in program.said().splitlines() if why in line]
                    self.assertEqual(len(told), 1, program.said())
                    self.assertIn("at a lower rate", told[0])

    def test_present_is_no_news(self):
        if library is None:
            self.skipTest(pack.why_not)
        with Program("timetagger.py") as program:
            program.address
            self.assertNotIn("at a lower rate", program.said())


if __name__ == "__main__":
    testing.main()
