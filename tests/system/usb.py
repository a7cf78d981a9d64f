#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/usb.py BIN_DIR: the real daemon and libusb record from a laboratory whose time tagger
is an emulated USB device."""
import json
import os
import pathlib
import re
import sqlite3
import subprocess
import sys
import tempfile
import unittest

bin_dir = pathlib.Path(sys.argv[1]).resolve()
usb_lab = bin_dir.parent / "tests/usb_lab"
environment = os.environ | {"PATH": f"{bin_dir}:{os.environ['PATH']}"}
WINDOW_S = float(os.environ.get("ECHOFUSE_TEST_WINDOW_S", "0.5"))  # longer: fewer tags a second


class Usb(unittest.TestCase):
    def test_record(self):
        with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
            lab, run = pathlib.Path(folder) / "lab", pathlib.Path(folder) / "run.sqlite"
            done = subprocess.run(
                [usb_lab, "--dir", lab, "--scene", "mixed", "--hold", "1", "--window",
                 str(WINDOW_S), "--", "echofuse-acquire", "run", "--config", lab / "lab.toml", "--out", run, "--count",
                 "10"], stderr=subprocess.PIPE, text=True, timeout=60, env=environment)
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

    def test_beside_a_run(self):
        """A USB device is locked, and its run does not notice the others."""
        with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
            lab, run = pathlib.Path(folder) / "lab", pathlib.Path(folder) / "run.sqlite"
            script = f"""
                echofuse-acquire run --config {lab}/lab.toml --out {run} --count 12 & run=$!
                until [ "$(echofuse-acquire info --json {run} 2>&1 | grep -c '"records": [1-9]')" = 1 ]; do sleep 0.1; done
                echofuse-acquire devices --config {lab}/lab.toml; echo "devices $?"
                echofuse-acquire run --config {lab}/lab.toml --out {folder}/second --count 1 2>&1; echo "second $?"
                wait $run; echo "run $? was $run" """
            done = subprocess.run([usb_lab, "--dir", lab, "--window", str(WINDOW_S), "--", "sh", "-c", script],
                                  capture_output=True, text=True, timeout=60, env=environment)
            out = done.stdout + done.stderr
            pid = re.search(r"run 0 was (\d+)", out)
            self.assertTrue(pid, out)
            holder = f"in use by echofuse-acquire run, pid {pid[1]}, run {run}"
            self.assertRegex(out, rf"spd usb:1209:0001:SIM-USB-1: {holder}; record \d+, [\d.]+ s ago: ok")
            self.assertIn("devices 0\n", out)
            self.assertIn("second 4\n", out)
            db = sqlite3.connect(run)
            rows = db.execute("SELECT valid & 1, spd_lost FROM record ORDER BY idx").fetchall()
            db.close()
        self.assertEqual(rows, [(1, 0)] * 12, out)

    def test_exit_code(self):
        with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
            def lab(*words):
                return subprocess.run([bin_dir / "echofuse-sim", "lab", "--dir", pathlib.Path(folder) / "lab", *words],
                                      stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, timeout=30)
            self.assertEqual(lab("--", "sh", "-c", "exit 7").returncode, 7)
            missing = lab("--", "no-such-program")
            self.assertEqual(missing.returncode, 1)
            self.assertIn("no-such-program: cannot start", missing.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
