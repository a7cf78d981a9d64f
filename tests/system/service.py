#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests the daemon when it is started by config/echofuse-acquire.service, and the checks that systemd makes on the unit."""
import configparser
import os
import pathlib
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import live
from fixtures import outcome
from live import wait_for

unit_path = pathlib.Path(__file__).resolve().parents[2] / "config/echofuse-acquire.service"


# If a key of the unit is repeated, its last value is used.
unit = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
unit.optionxform = str
unit.read(unit_path)


class NotifySocket:
    """Takes the place of systemd: reads the notify socket and stores the lines received."""

    def __init__(self, path):
        self.path = str(path)
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(self.path)
        self.lines = []
        self.thread = threading.Thread(target=self.keep)
        self.thread.start()

    def keep(self):
        while message := self.socket.recv(4096).decode():
            self.lines += message.splitlines()

    def close(self):
        """Waits until all messages sent so far have been read, and returns the lines."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
            end.sendto(b"", self.path)
        self.thread.join()
        self.socket.close()
        return self.lines


class Service(live.Live):
    def setUp(self):
        super().setUp()
        self.notify = NotifySocket(self.dir / "notify")

    def tearDown(self):
        if self.notify.thread.is_alive():
            self.notify.close()
        super().tearDown()

    def test_daemon_sends_a_watchdog_message_to_systemd_for_each_record(self):
        # The watchdog time of this service is shorter than four slots, so the daemon first requests a longer time.
        line = unit["Service"]["ExecStart"].replace("%%", "%").replace("/etc/echofuse", str(self.dir / "lab"))
        command = line.replace("/var/lib/echofuse", str(self.dir)).replace("/usr/local/bin", str(live.bin_dir)).split()
        daemon = self.start(command, env=self.environment(NOTIFY_SOCKET=self.notify.path, WATCHDOG_USEC="300000"), stderr=subprocess.PIPE, text=True)
        wait_for("run file", lambda: list(self.dir.glob("*.sqlite")) or daemon.poll() is not None)
        self.run, = self.dir.glob("*.sqlite")
        self.assertRegex(self.run.name, r"^run-20\d{6}-\d{6}\.sqlite$")
        wait_for("heartbeats", lambda: self.notify.lines.count("WATCHDOG=1") >= 4)
        blocker = sqlite3.connect(self.run, isolation_level=None)
        blocker.execute("BEGIN IMMEDIATE")
        try:
            # Heartbeats for records that were committed before the lock arrive within this time.
            time.sleep(0.5)
            before = self.notify.lines.count("WATCHDOG=1")
            # The pause must be shorter than 5 s, after which the writer gives up.
            time.sleep(min(8 * live.WINDOW_S, 3))
            self.assertEqual(self.notify.lines.count("WATCHDOG=1"), before)
            self.assertIsNone(daemon.poll())
        finally:
            blocker.execute("ROLLBACK")
            blocker.close()
        wait_for("heartbeats again", lambda: self.notify.lines.count("WATCHDOG=1") > before)
        self.finish(daemon, signal.SIGTERM)
        lines = self.notify.close()
        self.assertEqual(lines[:2], [f"WATCHDOG_USEC={round(4e6 * live.WINDOW_S)}", "READY=1"], lines)
        self.assertEqual((lines.count("READY=1"), lines.count("STOPPING=1")), (1, 1))
        self.assertNotIn("WATCHDOG=1", lines[lines.index("STOPPING=1"):])
        # There is at most one heartbeat per record, and the status reports the number of records.
        counts = [int(count) for count in re.findall(r"STATUS=(\d+) records on disk", "\n".join(lines))]
        self.assertEqual((counts, counts[0]), (sorted(counts), 0))
        self.assertLessEqual(max(counts[-1], lines.count("WATCHDOG=1")), len(self.rows()))

    def test_log_lines_in_the_journal_have_priorities(self):
        """Log lines begin with a priority instead of the time only if stderr is the journal. systemd does not treat a
        stop before the first slot as a failure, and does not restart the daemon after a disk error."""
        command = f'JOURNAL_STREAM="$(stat -Lc %d:%i /proc/self/fd/2)" exec {live.bin_dir}/echofuse-acquire run'
        config = f"--config {self.dir}/lab/lab.toml --set depth.address= --set radar.cli=serial:{self.dir}/none"
        tail = f"--set run.connect_timeout_s=1.5 --count 3 --out {self.dir}/run"
        done = subprocess.run(["sh", "-c", f"{command} {config} {tail}"], stderr=subprocess.PIPE, text=True, timeout=30)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stderr, r"(?m)^<6>recording to ")
        self.assertRegex(done.stderr, r"(?m)^<4>starting without radar")
        self.assertNotRegex(done.stderr, r"(?m)^<?\d*>?20\d\d-")
        # The address must be unique, because the daemon locks devices by address.
        pid = os.getpid()
        missing = "--set", "tdc.policy=required", "--set", (
            f"tdc.address=bridge:tcp://127.{pid >> 16}.{pid >> 8 & 255}.{pid & 255}:1")
        daemon = self.start([live.bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--out",
                             self.dir / "early", *missing], stderr=subprocess.PIPE, text=True)
        # The daemon handles signals from its first log line on.
        first = daemon.stderr.readline()
        log = first + self.finish(daemon, signal.SIGTERM, code=None)
        self.assertIn("interrupted before the first slot", log)
        self.assertIn(str(daemon.returncode), unit["Service"]["SuccessExitStatus"].split(), log)
        self.assertIn("6", unit["Service"]["RestartPreventExitStatus"].split())  # a full disk
        self.assertFalse((self.dir / "early.sqlite").exists())
        (self.dir / "bad.cfg").write_text("flushCfg\n")
        fault = subprocess.run(["sh", "-c", f"{command} {config} --set radar.cfg={self.dir}/bad.cfg"], capture_output=True, text=True, timeout=30)
        self.assertRegex(fault.stderr, r"^(<3>.*\n){2,}$")
        self.assertEqual(fault.returncode, 3)
        environment = os.environ | {"JOURNAL_STREAM": "1:1"}
        plain = outcome("echofuse-acquire", "run", "--out", "x", "--config", "/none", env=environment)
        self.assertTrue(plain.stderr.startswith("echofuse-acquire: /none"), plain.stderr)


class Exposure(unittest.TestCase):
    def test_systemd_accepts_the_service_unit(self):
        with tempfile.TemporaryDirectory() as folder:
            copy = pathlib.Path(folder) / unit_path.name
            copy.write_text(unit_path.read_text().replace("/usr/local/bin/echofuse-acquire", "/bin/true"))
            verify = subprocess.run(["systemd-analyze", "verify", copy], capture_output=True, text=True)
            self.assertEqual((verify.returncode, verify.stderr), (0, ""))
        # The sandbox must allow the system calls that are needed to start the program of alert.on_doubt.
        listed = subprocess.run(["systemd-analyze", "syscall-filter"], capture_output=True, text=True, check=True).stdout
        sets = {name: members.split() for name, members in re.findall(r"^(@\S+)\n((?: .*\n)+)", listed, re.M)}

        def calls(name):
            return set().union(*(calls(word) if word.startswith("@") else {word} for word in sets[name]))
        allowed = calls("@system-service") - calls("@privileged") - calls("@resources")
        self.assertLessEqual({"vfork", "clone3", "setpgid", "dup2", "close_range", "execve", "kill", "wait4"}, allowed)
        security = subprocess.run(["systemd-analyze", "security", "--offline=yes", "--threshold=20", unit_path],
                                  capture_output=True, text=True)
        self.assertEqual(security.returncode, 0, security.stdout + security.stderr)


if __name__ == "__main__":
    if "test_systemd_accepts_the_service_unit" in sys.argv[2:]:
        if not shutil.which("systemd-analyze"):
            print("skipped: systemd-analyze is not installed (apt-get install systemd)")
            sys.exit(77)
        unittest.main(argv=[sys.argv[0], "Exposure.test_systemd_accepts_the_service_unit"])
    live.main(Service)
