#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""replay.py BIN_DIR: a bridge that keeps what it could not send, and sends it on the next connection. Tags go where
their times say: into the slots that are open, or they are late, of the record that they belong to."""
import pathlib
import re
import socket
import sqlite3
import statistics
import struct
import sys
import threading
import time
import tomllib
import unittest

import live
from live import wait_for

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts/bridges"))
from bridge import HELLO, TAGS, block  # noqa: E402
from pack import NO_CRC  # noqa: E402

if NO_CRC:
    print(NO_CRC)
    sys.exit(77)
AWAY_S = 1.2


def read(stream, size):
    data = b""
    while len(data) < size:
        piece = stream.recv(size - len(data))
        if not piece:
            raise EOFError
        data += piece
    return data


class Keeper:
    """One connection to the laboratory, several to the daemon."""

    def __init__(self, target):
        self.target = target
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "bridge:tcp://127.0.0.1:%d" % self.listener.getsockname()[1]
        self.leave = threading.Event()
        self.replayed = 0  # tags
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        down = self.listener.accept()[0]
        with socket.create_connection(self.target) as up:
            number, kept, back = 0, [], None
            while True:
                head = read(up, 32)
                kind, size, dropped = struct.unpack_from("<6xH4xIQ", head)
                payload = read(up, size)
                if kind == HELLO:
                    self.hello = payload
                if self.leave.is_set() and back is None:
                    down.close()
                    back = time.monotonic() + AWAY_S
                if back and time.monotonic() < back:
                    kept.append((kind, payload, dropped))
                    continue
                if back and kept:
                    down = self.listener.accept()[0]
                    number = 0
                    kept.insert(0, (HELLO, self.hello, 0))
                for kind, payload, dropped in kept + [(kind, payload, dropped)]:
                    try:
                        down.sendall(block(kind, number, payload, dropped) + payload)
                    except OSError:
                        return
                    number += 1
                    self.replayed += len(payload) // 16 if kind == TAGS and kept else 0
                kept = []


class Replay(live.Live):
    def test_all(self):
        address = tomllib.loads((self.dir / "lab/lab.toml").read_text())["tdc"]["address"]
        host, port = re.search(r"//(.*):(\d+)", address).groups()
        keeper = Keeper((host, int(port)))
        daemon = self.record("--set", f"tdc.address={keeper.address}")
        wait_for("records", lambda: self.committed() >= 12)  # by then its clock is known
        keeper.leave.set()
        wait_for("replay", lambda: keeper.replayed > 0)
        before = self.committed()
        wait_for("records", lambda: self.committed() >= before + 6)
        daemon.send_signal(live.signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        rows = self.rows()
        self.check_slots(rows)
        usual = statistics.median(row["tags"] for row in rows)
        for row in rows:
            self.assertLess(row["tags"], 2.5 * usual, (row["idx"], log))
        db = sqlite3.connect(f"file:{self.run}?mode=ro", uri=True)
        late = dict(db.execute("SELECT idx, spd FROM late WHERE spd > 0"))
        total = db.execute("SELECT value FROM counter WHERE source = 'spd' AND name = 'late'").fetchone()[0]
        db.close()
        self.assertGreater(total, 0, log)
        self.assertEqual(sum(late.values()), total, log)
        for index, tags in late.items():
            self.assertLess(rows[index]["tags"] + tags, 2.5 * usual, (index, log))
            if index - 1 in late and index + 1 in late:  # all of it was late
                self.assertFalse(rows[index]["valid"] & 1, (index, log))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "Replay.test_all"])
