#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""packing.py BIN_DIR: compares scripts/bridges/pack.py with NumPy, and runs bridges without the packing library."""
import pathlib
import struct
import tempfile
import unittest
from unittest import mock

import _ctypes  # serves as a shared object that is not the packing library
import testing
from testing import Client, Program, crc32c, np

import bridge
import pack


def some_tags(size):
    """Returns random tags with frequent starts and overflows."""
    tags = np.random.default_rng(size).integers(0, 256, 16 * size, "u1").view(pack.RECORD)
    tags["type"] %= 8
    tags["channel"] %= 4
    return tags


class Packing(unittest.TestCase):
    def check(self, tags):
        """Checks that packing keeps only the tags of channels 2 (start) and 3, and all markers."""
        blocks = pack.pack(tags, (2, 3))
        tags = tags[np.isin(tags["channel"], (2, 3)) | np.isin(tags["type"], (1, 2, 3))]
        self.assertEqual(sum(b.items for b in blocks), len(tags))
        packed = np.frombuffer(b"".join(b.payload for b in blocks), pack.RECORD)
        for name in packed.dtype.names:
            np.testing.assert_array_equal(packed[name], tags[name])
        self.assertFalse(packed.view("u1")[1::16].any())  # the reserved byte is cleared
        self.assertEqual(sum(b.starts for b in blocks), np.count_nonzero(tags["channel"] == 2))
        self.assertEqual(sum(b.overflows for b in blocks), np.count_nonzero(tags["type"] == 2))

    def test_packed_tags_equal_the_numpy_result_for_any_number_of_tags(self):
        for size in (0, 1, 2, pack.BLOCK_TAGS, pack.BLOCK_TAGS + 1, 150_000):
            self.check(some_tags(size))

    def test_tags_of_channels_that_are_not_configured_are_not_packed(self):
        tags = some_tags(1000)
        tags["type"], tags["channel"] = 0, 2 + tags["channel"] % 2
        self.check(tags)

    def test_strided_arrays_are_packed_and_arrays_of_another_type_are_refused(self):
        self.check(some_tags(10_000)[::3])
        tags = some_tags(1000)
        tags.flags.writeable = False
        self.check(tags)
        with self.assertRaisesRegex(RuntimeError, "the library's tags have the format .*; expected"):
            pack.pack(np.zeros(3, [("time", "i8"), ("type", "u4"), ("channel", "i4")]), (1, 2))

    def test_packed_payload_does_not_share_memory_with_the_vendor_array(self):
        tags = some_tags(100)
        block, = pack.pack(tags, (1, 2))
        before = bytes(block.payload)
        tags.view("u1")[:] = 0xEE
        self.assertEqual(bytes(block.payload), before)

    def test_blocks_have_valid_crc32c_checksums(self):
        for size in (0, 1, 31, 100_000):
            payload = bytes(range(256)) * (size // 256) + bytes(size % 256)
            header = bridge.block(1, 7, payload, 3)
            self.assertEqual(bridge.block(1, 7, memoryview(payload), 3), header)
            self.assertEqual(struct.unpack("<I", header[28:])[0],
                             crc32c.crc32c(header[:28] + payload))


class Absent(unittest.TestCase):
    def test_camera_bridge_runs_without_the_packing_library(self):
        with Program("realsense.py", "--width", "64", "--height", "48",
                     ECHOFUSE_BRIDGE_LIBRARY="") as program, Client(program.address) as client:
            client.until(bridge.DEPTH)  # Client checks the CRCs

    def test_tagger_bridge_refuses_to_run_without_the_packing_library(self):
        with tempfile.TemporaryDirectory() as folder:
            text = pathlib.Path(folder) / "text.so"
            text.write_text("no library")
            for named, why in (("", "is missing"), (str(text), "cannot be used"),
                               (_ctypes.__file__, "cannot be used")):
                said = testing.ended("timetagger.py", ECHOFUSE_BRIDGE_LIBRARY=named)
                self.assertRegex(said, why + ".*ECHOFUSE_BRIDGE_LIBRARY")
                self.assertEqual(said.count("\n"), 1)

    def test_missing_crc32c_package_is_reported_by_name(self):
        with mock.patch.object(pack, "MISSING", "no crc32c"), testing.messages() as said:
            self.assertRaises(SystemExit, bridge.require_packages)
        self.assertIn("python3-crc32c", said.getvalue())


testing.main()
