#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""hostile_bridge.py BIN_DIR [TEST]: the real daemon beside a bridge that lies. What the healthy devices send stays in
valid records, and SIGTERM ends the run in 5 s."""
import os
import pathlib
import signal
import socket
import struct
import sys
import threading
import time
import unittest

import live
from live import wait_for

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts/bridges"))
from bridge import DEPTH, HELLO, TAGS, block  # noqa: E402
from pack import NO_CRC  # noqa: E402

if NO_CRC:
    print(NO_CRC)
    sys.exit(77)

HELLO_BLOCK = block(HELLO, 0, b'{"model": "liar"}') + b'{"model": "liar"}'


def whole(kind, number, payload):
    return block(kind, number, payload) + payload


def tags(number):
    begin = number * 500_000_000
    return whole(TAGS, number, b"".join(struct.pack("<BBHiq", 0, 0, 0, 1 + i % 2, begin + i * 500_000) for i in range(999)))


def depth(number, width=64, height=48, x=(-0.5, 0.01), y=(0.5, -0.01)):
    head = struct.pack("<IIQIffff", width, height, number * 33_333, number, *x, *y)
    return whole(DEPTH, number, head + b"\x10\x10" * (width * height))


def liars(count, claim):
    return b"".join(struct.pack("<4sHHIIQII", b"EFBR", 1, 1, i, claim, 0, 0, 0) for i in range(count))


class Hostile:
    """Serves one client after the other: a hello, 40 sound blocks, and then whatever the attack makes of a number."""

    def __init__(self, sound, attack, pause_s):
        self.sound, self.attack, self.pause_s = sound, attack, pause_s
        self.sent = 0
        self.stopped = False
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "bridge:tcp://127.0.0.1:%d" % self.listener.getsockname()[1]
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while not self.stopped:
            client = self.listener.accept()[0]
            with client:
                try:
                    self.serve(client)
                except OSError:
                    pass

    def serve(self, client):
        client.sendall(HELLO_BLOCK)
        for number in range(1, 41):
            client.sendall(self.sound(number))
            time.sleep(0.02)
        while not self.stopped:
            data = self.attack(41 + self.sent)
            self.sent += 1
            client.sendall(data)  # the daemon may end the connection in the middle of it
            time.sleep(self.pause_s)


class HostileBridge(live.Live):
    def suffer(self, sensor, attack, beside, pause_s=0.5, seconds=3, sound=None):
        """The records beside the attack; returns the log."""
        hostile = Hostile(sound or (tags if sensor == "tdc" else depth), attack, pause_s)
        daemon = self.record("--set", "run.connect_timeout_s=2", "--set", f"{sensor}.address={hostile.address}")
        try:
            wait_for("records", lambda: self.committed() >= 3)
            wait_for("attack", lambda: hostile.sent > 0)
            time.sleep(seconds)
            self.assertIsNone(daemon.poll(), "the run has ended")
            asked = time.monotonic()
            daemon.send_signal(signal.SIGTERM)
            log = self.finish(daemon)
            self.assertLess(time.monotonic() - asked, 5, log)
            self.assertEqual(daemon.returncode, 0, log)
        finally:
            hostile.stopped = True
        rows = self.rows()
        self.check_slots(rows)
        self.assertGreaterEqual(len(rows), seconds / live.WINDOW_S)
        bad = [(row["idx"], row["valid"]) for row in rows if row["valid"] & beside != beside]
        self.assertLessEqual(len(bad), len(rows) // 5, f"{bad}\n{log}")  # a busy machine stands still by itself
        return log

    def test_lengths_tagger(self):
        """128 KiB of headers that each claim 16 MiB, then zeros; the camera and the radar go on."""
        evil = liars(4096, 16 << 20) + bytes(16 << 20)
        self.suffer("tdc", lambda number: evil if number == 41 else HELLO_BLOCK, beside=6)

    def test_lengths_camera(self):
        """Half a million headers behind one lie, again and again; the tagger and the radar go on."""
        evil = liars(1, 16 << 20) + liars(1 << 19, 4096)
        self.suffer("depth", lambda number: evil, beside=3)

    def test_frames(self):
        """One pixel high and two million wide, from the first one on."""
        def evil(number):
            return depth(number, 2_000_000, 1)

        self.suffer("depth", evil, beside=3, sound=evil)

    def test_axes_that_change(self):
        """Thousands of frames a second, each with another axis: the log has a bound, and the disk is not blamed."""
        def evil(number):
            return b"".join(depth(number * 500 + i, 2, 1 + i % 2, (-0.5, 0.01 + i * 1e-5)) for i in range(500))

        log = self.suffer("depth", evil, beside=3, pause_s=0.02)
        self.assertLess(len(log.splitlines()), 300)
        self.assertRegex(log, "another axis|(depth: connected to.*\n){10}")  # a busy machine may begin the slots late

    def test_hello(self):
        """16 MiB of brackets take no memory, and are no hello."""
        evil = block(HELLO, 41, b"[" * (16 << 20)) + b"[" * (16 << 20)
        most = [0]

        def watch(number):
            for process in self.processes[1:]:
                try:
                    with open(f"/proc/{process.pid}/status") as status:
                        most[0] = max(most[0], *(int(line.split()[1]) for line in status if line.startswith("VmHWM")), 0)
                except (OSError, ValueError, TypeError):
                    pass
            return evil

        self.suffer("tdc", watch, beside=6)
        self.assertGreater(most[0], 0)
        self.assertLess(most[0], 400 << 10, "kB")


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"HostileBridge.{name}" for name in
                                       sys.argv[2:] or [n for n in dir(HostileBridge)
                                                        if n.startswith("test_") and n not in dir(live.Live)])])
