#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""faulty_bridge.py BIN_DIR: the real daemon and the real simulated laboratory, with a TCP proxy in
front of the time tagger that damages, stalls and cuts. It knows the blocks, so it knows the damage."""
import re
import socket
import struct
import sys
import threading
import time
import tomllib
import unittest

import live
from live import wait_for


class Proxy:
    """Forwards block by block. do(fault) applies to the next block of tags and says what it costs."""

    def __init__(self, target):
        self.target = target
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "bridge:tcp://127.0.0.1:%d" % self.listener.getsockname()[1]
        self.tags = 0         # in blocks that went through sound, once
        self.lost = 0         # blocks that the daemon must have missed, and tags that the laboratory dropped
        self.connections = 0
        self.fault, self.done = None, threading.Event()
        self.refuse_until = 0.0
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            down = self.listener.accept()[0]
            if time.monotonic() < self.refuse_until:
                down.close()
                continue
            self.connections += 1
            self.lost += self.connections > 1  # the daemon knows of one at least
            with down, socket.create_connection(self.target) as up:
                down.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                try:
                    while self.forward(down, up):
                        pass
                except OSError:
                    pass

    def forward(self, down, up):
        head = read(up, 32)
        kind, size = struct.unpack_from("<6xH4xI", head)
        block = head + read(up, size)
        self.lost += struct.unpack_from("<Q", head, 16)[0]  # a stall fills its queue
        fault = self.fault if kind == 1 else None
        if fault is None:
            down.sendall(block)
            self.tags += size // 16 if kind == 1 else 0
            return True
        if fault == "hold" or fault in BREAKS:
            down.sendall(BREAKS.get(fault, lambda b: b"")(block))
            self.fault = None if fault in BREAKS else fault
            self.done.set()
            return bool(down.recv(1))  # until the daemon goes
        if fault == "close in a block":
            down.sendall(block[:20])
        elif fault != "close":
            tags, lost, data = FAULTS[fault](block)
            self.tags += tags
            self.lost += lost
            down.sendall(data)
        self.fault = None
        self.done.set()
        return not fault.startswith("close")

    def do(self, fault):
        self.done.clear()
        self.fault = fault
        assert self.done.wait(10), fault


def read(stream, size):
    data = b""
    while len(data) < size:
        piece = stream.recv(size - len(data))
        if not piece:
            raise OSError("closed")
        data += piece
    return data


def tags_of(block):
    return (len(block) - 32) // 16


def flipped(block, at):
    return block[:at] + bytes([block[at] ^ 4]) + block[at + 1:]


def stall(block):
    time.sleep(1.0)
    return tags_of(block), 0, block


# block -> bytes to send, after which the daemon ends the connection
BREAKS = {
    "bit flip in the payload": lambda b: flipped(b, 40),
    "bit flip in the header": lambda b: flipped(b, 9),
    "truncated": lambda b: b[:-10] + b,
    "garbage": lambda b: bytes(range(256)) * 40 + b"EFBR" + b,
    "lying length": lambda b: b[:12] + struct.pack("<I", 1 << 24) + b[16:32] + b,
}
# block -> tags that still arrive, blocks that do not, bytes to send
FAULTS = {
    "omitted": lambda b: (0, 1, b""),
    "stall": stall,
}
# SPD records from the fault on that may be invalid: pauses before a new connection grow up to 2 s
SPD_OUT_S = dict.fromkeys((*BREAKS, "close in a block", "close"), 3.5) | {"lying length": 8.0, "stall": 1.5, "away": 9.0,
                                                                          "hold": 60.0}  # to the end


class FaultyBridge(live.Live):
    def test_all(self):
        address = tomllib.loads((self.dir / "lab/lab.toml").read_text())["tdc"]["address"]
        host, port = re.search(r"//(.*):(\d+)", address).groups()
        proxy = Proxy((host, int(port)))
        daemon = self.record("--set", f"tdc.address={proxy.address}")
        wait_for("records", lambda: self.committed() >= 3)
        out = []  # (from, until) where the SPD may be missing
        began = time.monotonic_ns()

        def suffer(fault, act):
            before = self.committed()
            start = time.monotonic_ns()
            act()
            pause_s = SPD_OUT_S.get(fault, 0)
            if pause_s:
                out.append((start, start + round(pause_s * 1e9)))
            time.sleep(min(pause_s, 5))  # what the schedule of the faults is made of
            wait_for("records", lambda: self.committed() >= before + 2)

        for fault in (*BREAKS, *FAULTS, "close in a block", "close"):
            suffer(fault, lambda: proxy.do(fault))
        connections = proxy.connections

        def go_away():
            proxy.refuse_until = time.monotonic() + 2.0
            proxy.do("close")

        suffer("away", go_away)
        wait_for("bridge", lambda: proxy.connections > connections)
        suffer("hold", lambda: proxy.do("hold"))  # what was sent until here has time to arrive
        daemon.send_signal(live.signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)

        rows = self.rows()
        self.check_slots(rows)
        self.assertGreaterEqual(rows[-1]["slot_end_ns"], began)
        for row in rows:
            self.assertEqual(row["valid"] & 6, 6, f"record {row['idx']}\n{log}")
            excused = any(row["slot_start_ns"] < until and row["slot_end_ns"] > since for since, until in out)
            self.assertTrue(row["valid"] & 1 or excused, f"record {row['idx']}: {row['spd_verdict']}\n{log}")
        self.assertEqual(sum(row["tags_lost"] for row in rows), proxy.lost, log)
        arrived = int(re.search(r"arrived: (\d+) tags", log).group(1))
        self.assertEqual(arrived, proxy.tags, log)
        for said in "whose checksum is wrong", "that begin no block", "no block came for 4 s":
            self.assertIn(said, log)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "FaultyBridge.test_all"])
