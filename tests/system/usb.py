#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/usb.py BIN_DIR: the real daemon and libusb record from a laboratory whose time tagger
is an emulated USB device."""
import json
import os
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest

bin_dir = pathlib.Path(sys.argv[1]).resolve()
WINDOW_S = float(os.environ.get("ECHOFUSE_TEST_WINDOW_S", "0.5"))  # longer: fewer tags a second


class Usb(unittest.TestCase):
    def test_record(self):
        with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
            lab, run = pathlib.Path(folder) / "lab", pathlib.Path(folder) / "run.sqlite"
            done = subprocess.run(
                [bin_dir / "echofuse-sim", "lab", "--usb", "--dir", lab, "--scene", "mixed", "--hold", "1", "--window",
                 str(WINDOW_S), "--", "echofuse-acquire", "run", "--config", lab / "lab.toml", "--out", run, "--count",
                 "10"], stderr=subprocess.PIPE, text=True, timeout=60)
            self.assertEqual(done.returncode, 0, done.stderr)
            sent = json.loads((lab / "sent.json").read_text())["tdc"]
            db = sqlite3.connect(run)
            rows = db.execute("SELECT valid, spd_lost FROM record ORDER BY idx").fetchall()
            devices = dict(db.execute("SELECT sensor, serial FROM device").fetchall())
            db.close()
        self.assertEqual(rows, [(7, 0)] * 10, done.stderr)
        self.assertEqual(devices["spd"], "SIM-USB-1")
        self.assertEqual((sent["lost"], sent["starts"]), (0, 1))
        # What was still in the device when the daemon stopped it: at most what it makes in 0.2 s.
        arrived = int(done.stderr.split("arrived: ")[1].split(" tags")[0])
        self.assertLessEqual(arrived, sent["tags"])
        self.assertLess(sent["tags"] - arrived, 0.2 / (10 * WINDOW_S) * sent["tags"], done.stderr)

    def test_exit_code_and_usage(self):
        with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
            def lab(*words):
                return subprocess.run([bin_dir / "echofuse-sim", "lab", "--dir", pathlib.Path(folder) / "lab", *words],
                                      stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, timeout=30)
            self.assertEqual(lab("--", "sh", "-c", "exit 7").returncode, 7)
            missing = lab("--", "no-such-program")
            self.assertEqual(missing.returncode, 1)
            self.assertIn("no-such-program: cannot start", missing.stderr)
            alone = lab("--usb")
            self.assertEqual(alone.returncode, 2)
            self.assertIn("add e.g. -- echofuse-acquire run", alone.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
