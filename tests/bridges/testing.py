# SPDX-License-Identifier: MIT
"""Common parts of the bridge tests: module paths, an independent block reader, and a class that runs a bridge."""
import contextlib
import io
import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import types
import unittest

here = pathlib.Path(__file__).resolve().parent
root = here.parent.parent
try:
    import crc32c
    import numpy as np
except ImportError as error:
    print(f"skipped: {error} (Debian: python3-numpy python3-crc32c)")
    sys.exit(77)
sys.dont_write_bytecode = True
# Packing library of the tested build. If the file is missing, the bridges run without it.
library = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "").resolve().parent / "lib/libechofuse_bridge_pack.so"
os.environ.setdefault("ECHOFUSE_BRIDGE_LIBRARY", str(library))
sys.path[:0] = [str(root / "scripts/bridges"), str(here / "stand_in"), str(here.parent), str(here.parent / "fixtures"),
                str(root / "recon/python")]
from waiting import wait_for


def golden():
    """Returns the four blocks in tests/golden/bridge.hex: hello, tags, depth and bye."""
    text = (root / "tests/golden/bridge.hex").read_text(encoding="utf-8")
    return [bytes.fromhex(digits) for digits in re.split("(?:^#.*\n)+", text, flags=re.M)[1:]]


Block = types.SimpleNamespace


class Client:
    """Reads blocks from a bridge. Checks the magic, the version and the CRC of each block, and that no block is
    missing."""

    def __init__(self, address):
        self.socket = socket.create_connection(address, timeout=10)
        self.next = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def exactly(self, size):
        data = b""
        while len(data) < size:
            piece = self.socket.recv(size - len(data))
            if not piece:
                raise EOFError
            data += piece
        return data

    def block(self):
        head = self.exactly(32)
        magic, version, kind, sequence, size, dropped, zero, crc = struct.unpack("<4sHHIIQII", head)
        payload = self.exactly(size)
        assert (magic, version, zero) == (b"EFBR", 1, 0), head
        assert crc == crc32c.crc32c(head[:28] + payload), "CRC"
        assert sequence == self.next, (sequence, self.next)
        self.next += 1
        return Block(kind=kind, dropped=dropped, payload=payload)

    def until(self, kind):
        """Returns all blocks up to and including the first block of the given kind."""
        blocks = [self.block()]
        while blocks[-1].kind != kind:
            blocks.append(self.block())
        return blocks


def connect(address):
    """Tries to connect until the bridge accepts the client. Returns the client after its hello block."""
    while True:
        client = Client(address)
        if client.block().kind == 0:
            return client
        client.socket.close()
        time.sleep(0.05)


class Program:
    """Runs a bridge as a process with the stand-in libraries."""

    def __init__(self, script, *arguments, path=here / "stand_in", **env):
        self.folder = tempfile.TemporaryDirectory(prefix="echofuse-")
        self.log = pathlib.Path(self.folder.name) / "calls"
        self.talk = pathlib.Path(self.folder.name) / "stderr"
        env = os.environ | {"PYTHONPATH": str(path), "PYTHONDONTWRITEBYTECODE": "1", "STAND_IN_LOG": str(self.log)} | env
        with open(self.talk, "w", encoding="utf-8") as talk:
            self.process = subprocess.Popen([sys.executable, root / "scripts/bridges" / script, "--listen",
                                             "127.0.0.1:0", *arguments], env=env, stderr=talk)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.folder.cleanup()

    def said(self):
        return self.talk.read_text(encoding="utf-8")

    def calls(self):
        return [tuple(json.loads(line)) for line in self.log.read_text(encoding="utf-8").splitlines()]

    @property
    def address(self):
        wait_for("address", lambda: "listening on" in self.said() or self.process.poll() is not None)
        host, port = re.search(r"listening on (\S+):(\d+)", self.said()).groups()
        return host, int(port)

    def stop(self, how=signal.SIGTERM):
        self.process.send_signal(how)
        return self.process.wait(60)

    def sent(self):
        """Returns the totals printed by the bridge on exit: sent items, clients and dropped items."""
        return tuple(map(int, re.search(r"sent (\d+) \w+ to (\d+) clients, and dropped (\d+)", self.said()).groups()))


class Outlet:
    """Replaces the server of the bridge and stores the blocks."""

    def __init__(self):
        self.blocks, self.lost, self.dropped = [], 0, 0

    def send(self, kind, payload, items):
        self.blocks.append((kind, bytes(payload), items))

    def lose(self, items):
        self.lost += items


def ended(script, *arguments, code=4, **env):
    """Runs a bridge that ends by itself with the exit code `code`. Returns its messages."""
    with Program(script, *arguments, **env) as program:
        assert program.process.wait(60) == code, program.said()
        return program.said()


def messages():
    return contextlib.redirect_stderr(io.StringIO())


def config(path, window_s=0.2, **bridges):
    """Writes a configuration file with the bridge of each sensor."""
    path.write_text(f"run.window_s = {window_s}\n" + "".join(
        '%s.address = "bridge:tcp://%s:%d"\n' % (table, *bridge.address) for table, bridge in bridges.items()), encoding="utf-8")
    return path


def run_program(*words, ok=(0,)):
    """Runs a program of the tested build and returns its output. The exit code must be one of `ok`."""
    done = subprocess.run([pathlib.Path(sys.argv[1]) / words[0], *map(str, words[1:])], capture_output=True, text=True, timeout=300)
    assert done.returncode in ok, done.stderr
    return done.stdout


def main():
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
