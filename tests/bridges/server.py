#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests the common part of all bridges: the framing of blocks, and the server, which accepts one client at a time."""
import socket
import time
import unittest

import testing
from testing import Client, golden

import bridge


def make_server(test, **options):
    server = bridge.Server(("127.0.0.1", 0), **options)
    test.addCleanup(server.close)
    return server


class Framing(unittest.TestCase):
    def test_block_headers_equal_the_golden_file(self):
        for number, (kind, dropped) in enumerate([(0, 0), (1, 0), (2, 5), (3, 0)]):
            whole = golden()[number]
            self.assertEqual(bridge.block(kind, number, whole[32:], dropped), whole[:32])

    def test_block_sequence_number_wraps_at_32_bits(self):
        self.assertEqual(bridge.block(1, 1 << 32, b"x"), bridge.block(1, 0, b"x"))

    def test_listen_address_is_split_into_host_and_port(self):
        self.assertEqual(bridge.listen_address("[::1]:41110"), ("::1", 41110))
        self.assertEqual(bridge.listen_address("tagger.lab:0"), ("tagger.lab", 0))


class Devices(unittest.TestCase):
    def test_device_is_chosen_by_serial_number(self):
        self.assertEqual(bridge.choose(["A"], "", "board"), "A")
        self.assertEqual(bridge.choose(["A", "B"], "B", "board"), "B")
        for attached, serial, why in (([], "", "no board is connected"),
                                      (["A", "B"], "", "choose one with --serial: A, B"),
                                      (["A", "B"], "C", "no board with the serial number C")):
            with self.assertRaisesRegex(RuntimeError, why):
                bridge.choose(attached, serial, "board")


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


testing.main()
