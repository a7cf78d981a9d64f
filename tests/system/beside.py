#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""beside.py BIN_DIR [TEST]: what others do beside a live run of the real daemon."""
import os
import pathlib
import resource
import signal
import sqlite3
import subprocess
import sys
import time
import unittest

import live
from live import WINDOW_S, wait_for


class Beside(live.Live):
    def begin(self, *options):
        daemon = self.record(*options)
        wait_for("records", lambda: self.committed() >= 4)
        return daemon

    def check_rescued(self, daemon, before, said):
        log = self.finish(daemon)
        rescued = self.dir / "run.rescued.sqlite"
        self.assertEqual(daemon.returncode, 6, log)
        self.assertIn(f"{self.run}: {said}", log)
        self.run = rescued
        info = self.info()
        self.assertIn(f"its {info['records']} records are in {rescued}", log)
        self.assertEqual(info["status"], "stopped:disk")
        self.assertGreaterEqual(info["records"], before)
        self.check_slots(self.rows())

    def test_replaced(self):
        daemon = self.begin()
        before = self.committed()
        (self.dir / "x").touch()
        (self.dir / "x").rename(self.run)
        self.check_rescued(daemon, before, "was replaced by another file during the run")
        self.assertEqual((self.dir / "run.sqlite").stat().st_size, 0)
        self.assertFalse((self.dir / "run.sqlite-wal").exists())

    def test_wal_removed(self):
        daemon = self.begin()
        before = self.committed()
        pathlib.Path(f"{self.run}-wal").unlink()
        self.check_rescued(daemon, before, "its -wal file was removed or renamed during the run")

    def test_reader_holds(self):
        """Somebody reads and forgets it: SIGTERM closes the run as fast as ever."""
        daemon = self.begin()
        reader = sqlite3.connect(f"file:{self.run}?mode=ro", uri=True, isolation_level=None)
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM record").fetchone()
        before = self.committed()
        wait_for("more records", lambda: self.committed() > before)
        sent = time.monotonic()
        daemon.send_signal(signal.SIGTERM)
        log = self.finish(daemon)
        self.assertLess(time.monotonic() - sent, 5)
        self.assertEqual(daemon.returncode, 0, log)
        self.assertIn(f"its last records stay in {self.run}-wal", log)
        info = self.info()
        self.assertEqual(info["status"], "complete")
        self.assertTrue(pathlib.Path(f"{self.run}-wal").exists())
        self.check_slots(self.rows())
        reader.close()
        self.assertEqual(self.info(), info)
        self.assertFalse(pathlib.Path(f"{self.run}-wal").exists())

    def hold(self):
        other = sqlite3.connect(self.run, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        self.addCleanup(other.close)
        return other

    def test_writer_holds_for_a_while(self):
        """A database browser with an edit that is not committed yet: records wait, none is lost."""
        daemon = self.begin()
        other = self.hold()
        before = self.committed()
        time.sleep(6 * WINDOW_S)
        self.assertEqual(self.committed(), before)
        other.execute("ROLLBACK")
        wait_for("records", lambda: self.committed() >= before + 6)
        daemon.send_signal(signal.SIGTERM)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        self.assertIn("another program holds it by a write transaction; records wait in memory", log)
        self.assertNotIn("given up", log)
        self.assertEqual(self.info()["status"], "complete")
        self.check_slots(self.rows())

    def test_writer_holds_to_the_end(self):
        daemon = self.begin()
        self.hold()
        before = self.committed()
        time.sleep(6 * WINDOW_S)
        sent = time.monotonic()
        daemon.send_signal(signal.SIGTERM)
        log = self.finish(daemon)
        self.assertLess(time.monotonic() - sent, 5)
        self.assertEqual(daemon.returncode, 6, log)
        held, self.run = self.run, self.dir / "run.rescued.sqlite"
        info = self.info()
        self.assertIn(f"{held}: another program held it by a write transaction; all {info['records']} records are in "
                      f"{self.run}", log)
        self.assertGreater(info["records"], before)
        self.assertEqual(info["status"], "stopped:disk")
        self.check_slots(self.rows())

    def test_pause_of_many_slots(self):
        """More slots than the disk's queue holds become due at once: the pause is told, and no disk is blamed."""
        daemon = self.record("--set", "run.window_s=0.05")
        wait_for("records", lambda: self.committed() >= 4)
        daemon.send_signal(signal.SIGSTOP)
        time.sleep(8)
        daemon.send_signal(signal.SIGCONT)
        behind = self.committed() + 160
        wait_for("the slots of the pause", lambda: self.committed() >= behind)
        daemon.send_signal(signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        self.assertNotIn("the disk is too slow", log)
        rows = self.rows()
        self.assertEqual([row["idx"] for row in rows], list(range(len(rows))))
        self.assertFalse([row["idx"] for row in rows if row["spd_verdict"].startswith("dropped")])

    def test_file_size_limit(self):
        """SIGXFSZ does not kill: the run ends as on a full disk."""
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

        daemon = self.record("--set", "depth.address=", preexec_fn=limit)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 6, log)
        self.assertEqual(self.info()["status"], "stopped:disk")
        self.check_slots(self.rows())

    def test_read_only(self):
        """A run on a file system that has become read-only is not continued, and says why."""
        disk = self.dir / "disk"
        disk.mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", disk], stderr=subprocess.DEVNULL).returncode:
            self.skipTest("no permission to mount a tmpfs")
        try:
            self.run = disk / "run.sqlite"
            daemon = self.record("--count", "2")
            log = self.finish(daemon)
            self.assertEqual(daemon.returncode, 0, log)
            subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
            log, code = self.resume()
            self.assertEqual(code, 6, log)
            self.assertIn("run.sqlite: it is on a read-only file system", log)
            self.assertEqual(self.info()["records"], 2)
            self.run = disk / "new.sqlite"
            daemon = self.record("--count", "2")
            log = self.finish(daemon)
            self.assertEqual(daemon.returncode, 6, log)
            self.assertIn("new.sqlite: its folder is on a read-only file system", log)
        finally:
            subprocess.run(["umount", disk], check=True)

    def test_lock_is_a_link(self):
        victim = self.dir / "victim"
        victim.write_text("precious")
        os.symlink(victim, f"{self.run}-lock")
        daemon = self.record("--count", "2")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 1, log)
        self.assertIn("run.sqlite-lock: is not a lock file of echofuse", log)
        self.assertEqual(victim.read_text(), "precious")
        self.assertFalse(self.run.exists())


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"Beside.{name}" for name in sys.argv[2:])])
