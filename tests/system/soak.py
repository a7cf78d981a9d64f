#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/soak.py BIN_DIR: a short soak passes its audit, and the audit sees what is falsified."""
import json
import os
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import unittest

bin_dir = pathlib.Path(sys.argv[1]).resolve()
scripts = pathlib.Path(__file__).resolve().parents[2] / "scripts"
SLOTS = 60
WINDOW_S = os.environ.get("ECHOFUSE_TEST_WINDOW_S", "0.1")  # longer: fewer tags a second


def run(*command):
    return subprocess.run([sys.executable, *map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


class Soak(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="echofuse-")
        cls.dir = pathlib.Path(cls.folder.name)
        # A busy machine is late; that is not what is tested here.
        cls.soak = run(scripts / "soak", "--slots", SLOTS, "--window", WINDOW_S, "--late-ms", 2000, "--bin", bin_dir, "--keep", cls.dir)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def audit(self, run_file):
        done = run(scripts / "audit_run.py", run_file, self.dir / "log.jsonl", "--json")
        return done.returncode, json.loads(done.stdout)

    def test_short_soak(self):
        self.assertEqual(self.soak.returncode, 0, self.soak.stdout)
        code, account = self.audit(self.dir / "run.sqlite")
        self.assertEqual((code, account["unexplained"]), (0, []))
        self.assertEqual(account["run"]["records"], SLOTS)
        for device, loss in (("tdc", "not delivered: dropped"), ("tdc", "not delivered: corrupt"),
                             ("radar", "sent: dropped"), ("depth", "sent: dropped"), ("depth", "sent: corrupt")):
            self.assertGreater(account[device].get(loss, 0), 0, (device, loss))

    def test_random_faults(self):
        folder = self.dir / "random"
        done = run(scripts / "soak", "--slots", SLOTS, "--window", WINDOW_S, "--random", 5, "--late-ms", 2000, "--bin", bin_dir,
                   "--keep", folder)
        self.assertEqual(done.returncode, 0, done.stdout)
        faults = (folder / "faults.toml").read_text()
        self.assertGreaterEqual(len(set(line for line in faults.splitlines() if line.startswith("kind"))), 5)

    def test_falsified_records(self):
        last = "idx = (SELECT max(idx) FROM slot WHERE {}_frames > 0)"
        first = "idx = (SELECT min(idx) FROM slot WHERE {}_frames > 0)"
        for statement, sensor in (
                ("UPDATE counter SET value = value + 1000000000 WHERE source = 'spd' AND name = 'tags'", "tdc"),
                (f"UPDATE record SET tags = tags + 1000000000 WHERE idx = {SLOTS // 2}", "tdc"),
                (f"UPDATE record SET spd_lost = spd_lost + 1000000000 WHERE idx = {SLOTS // 2}", "tdc"),
                ("UPDATE slot SET radar_frames = radar_frames + 1 WHERE " + last.format("radar"), "radar"),
                ("UPDATE slot SET depth_frames = depth_frames + 1 WHERE " + first.format("depth"), "depth"),
                ("UPDATE counter SET value = value + 1 WHERE source = 'depth' AND name = 'early'", "depth"),
                ("UPDATE record SET depth_lost = depth_lost + 1 WHERE " + last.format("depth"), "depth")):
            copy = self.dir / "falsified.sqlite"
            shutil.copy(self.dir / "run.sqlite", copy)
            db = sqlite3.connect(copy)
            self.assertEqual(db.execute(statement).rowcount, 1, statement)
            db.commit()
            db.close()
            code, account = self.audit(copy)
            self.assertEqual(code, 1, statement)
            self.assertIn(sensor + ":", " ".join(account["unexplained"]), statement)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[2:])
