#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests the common part of all bridges: the framing of blocks, the server, which accepts one client at a time, and pack.py."""
import _ctypes  # serves as a shared object that is not the packing library
import ast
import pathlib
import socket
import tempfile
import time
import unittest
from unittest import mock

import testing
from testing import Client, Program, golden, np
import bridge
import pack
import pyorbbecsdk
import pyrealsense2
import TimeTagger
from recorder import published


def make_server(test, **options):
    server = bridge.Server(("127.0.0.1", 0), **options)
    test.addCleanup(server.close)
    return server


class Framing(unittest.TestCase):
    def test_block_headers_equal_the_golden_file(self):
        for number, (kind, dropped) in enumerate([(0, 0), (1, 0), (2, 5), (3, 0)]):
            whole = golden()[number]
            for sequence in number, number + (1 << 32):
                self.assertEqual(bridge.block(kind, sequence, memoryview(whole[32:]), dropped), whole[:32])

    def test_listen_address_is_split_into_host_and_port(self):
        self.assertEqual(bridge.listen_address("[::1]:41110"), ("::1", 41110))
        self.assertEqual(bridge.listen_address("tagger.lab:0"), ("tagger.lab", 0))


class OneClient(unittest.TestCase):
    def test_each_connection_begins_with_a_hello_block(self):
        server = make_server(self)
        server.online({"model": "m"})
        with Client(server.address) as client:
            began = time.monotonic()
            hellos = [client.block() for _ in range(3)]
            self.assertLess(time.monotonic() - began, 2.0)  # hello blocks are sent every 0.5 s
            self.assertEqual([b.kind for b in hellos], [bridge.HELLO] * 3)
            self.assertEqual({b.payload for b in hellos}, {b'{"model": "m"}'})
            again = 0
            while again < 2:  # hello blocks are also sent between data blocks
                server.send(bridge.TAGS, bytes(16), 1)
                again += client.block().kind == bridge.HELLO
            self.assertLess(time.monotonic() - began, 4.0)

    def test_second_client_is_refused_while_the_first_is_connected(self):
        server = make_server(self)
        server.online({})
        with Client(server.address) as first:
            first.block()
            with Client(server.address) as second:
                self.assertEqual(second.block().kind, bridge.BYE)
                self.assertRaises(EOFError, second.block)
            server.send(bridge.TAGS, bytes(16), 1)
            self.assertEqual(first.until(bridge.TAGS)[-1].payload, bytes(16))
        testing.wait_for("farewell", lambda: server._client is None)
        with Client(server.address) as third:  # the block numbers restart at 0
            self.assertEqual(third.block().kind, bridge.HELLO)
        self.assertEqual(server.clients, 2)

    def test_clients_are_refused_while_no_device_is_open(self):
        server = make_server(self)
        with Client(server.address) as client:
            self.assertEqual(client.block().kind, bridge.BYE)
        server.online({})
        with Client(server.address) as client:
            client.block()
            server.send(bridge.TAGS, bytes(16), 1)
            server.offline()
            server.send(bridge.TAGS, bytes(16), 1)  # this block is dropped, because the device is offline
            self.assertEqual([b.kind for b in client.until(bridge.BYE)], [bridge.TAGS, bridge.BYE])
            self.assertRaises(EOFError, client.block)
        self.assertEqual(server.sent, 1)

    def test_closing_the_server_sends_queued_blocks(self):
        server = make_server(self)
        server.online({})
        with Client(server.address) as client:
            client.block()
            for _ in range(100):
                server.send(bridge.TAGS, bytes(16 * 1000), 1000)
            server.close()
            kinds = [b.kind for b in client.until(bridge.BYE)]
        self.assertEqual((kinds.count(bridge.TAGS), kinds[-1]), (100, bridge.BYE))
        self.assertEqual((server.sent, server.dropped), (100_000, 0))

    def test_next_block_contains_the_number_of_lost_items(self):
        server = make_server(self)
        server.lose(5)  # the loss is not reported, because no client is connected
        server.online({})
        with Client(server.address) as client:
            client.block()
            server.lose(2)
            server.lose(1)
            server.send(bridge.TAGS, bytes(16), 1)
            self.assertEqual(sum(b.dropped for b in client.until(bridge.TAGS)), 3)
        self.assertEqual(server.dropped, 3)


class SlowClient(unittest.TestCase):
    def test_memory_is_bounded_and_lost_tags_are_counted_if_the_client_is_slow(self):
        server = make_server(self, queue_bytes=1 << 20)
        server.online({})
        with Client(server.address) as client:
            client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
            client.block()
            given = 0
            while server.dropped < 100_000:  # the queue fills up, because the client does not read
                server.send(bridge.TAGS, bytes(16 * 4096), 4096)
                given += 4096
                self.assertLessEqual(server._queued_bytes, 1 << 20)
            read = [client.block() for _ in range(5)]
            while server._queue:
                read.append(client.block())
            server.send(bridge.TAGS, bytes(16), 1)  # this block reports the dropped items
            server.offline()
            read += client.until(bridge.BYE)
        arrived = sum(len(b.payload) // 16 for b in read if b.kind == bridge.TAGS)
        dropped = sum(b.dropped for b in read)
        self.assertEqual(arrived + dropped, given + 1)
        self.assertEqual((server.sent, server.dropped), (arrived, dropped))

    def test_blocks_lost_by_a_disconnected_client_are_not_reported_to_the_next_client(self):
        server = make_server(self, queue_bytes=1 << 24)
        server.online({})
        with Client(server.address) as client:
            client.block()
            for _ in range(60):
                server.send(bridge.TAGS, bytes(1 << 18), 1 << 14)
        testing.wait_for("farewell", lambda: server._client is None)
        self.assertLess(server.sent, 60 << 14)
        with Client(server.address) as client:
            self.assertEqual(client.block().dropped, 0)
            server.send(bridge.TAGS, b"", 0)
            self.assertEqual(client.until(bridge.TAGS)[-1].dropped, 0)


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


def calls(script, owners):
    """Returns the names of the methods that a bridge script calls on variables named in `owners`."""
    tree = ast.parse((testing.root / "scripts/bridges" / script).read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            base = node.func.value
            owner = base.attr if isinstance(base, ast.Attribute) else getattr(base, "id", "")
            if owner in owners:
                found.add(node.func.attr)
    return found


class Signatures(unittest.TestCase):
    def test_bridges_call_only_functions_that_the_vendors_published(self):
        for script, library, more, least, owners in (
                ("timetagger.py", TimeTagger, {"take", "Replay"}, 15, "library _library tagger _tagger _stream data"),
                ("orbbec.py", pyorbbecsdk, set(), 20, "_sdk sdk _context devices device info _pipeline _config profiles profile frames "
                                                      "frame modes presets"),
                ("realsense.py", pyrealsense2, set(), 16, "sdk _pipeline _config device profile frames frame sensor")):
            table = [*published(library.PUBLISHED)]
            called = calls(script, owners.split())
            self.assertEqual(called - {name for owner, function, _ in table for name in (owner, function)} - more, set())
            self.assertGreater(len(called), least)


testing.main()
