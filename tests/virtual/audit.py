#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that scripts/audit_run.py detects manipulated counts in a run that was recorded with faults. Called as
`tests/virtual/audit.py VIRTUAL_RUN`."""
import json
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import unittest

import soak

program = pathlib.Path(sys.argv[1]).resolve()
SCHEMA = json.loads((pathlib.Path(__file__).parents[2] / "config/schema.json").read_text(encoding="utf-8"))
SLOTS = 400


class Audit(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="echofuse-", dir=soak.folder_in_memory)
        cls.dir = pathlib.Path(cls.folder.name)
        soak.record(program, cls.dir, soak.faults(SLOTS * soak.WINDOW_S, seed=3), SLOTS, seed=3)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def audit(self, run_file):
        done = subprocess.run([sys.executable, soak.scripts / "audit_run.py", run_file, self.dir / "log.jsonl", "--json"],
                              stdout=subprocess.PIPE)
        account = json.loads(done.stdout)
        self.assertEqual(set(account), set(SCHEMA["scripts/audit_run.py"]))
        return done.returncode, account

    def test_valid_run_passes_the_audit(self):
        code, account = self.audit(self.dir / "run.sqlite")
        self.assertEqual((code, account["unexplained"]), (0, []))
        self.assertEqual(account["run"]["records"], SLOTS)
        for device, loss in (("tdc", "not delivered: dropped"), ("radar", "counted as lost"), ("depth", "counted as lost")):
            self.assertGreater(account[device].get(loss, 0), 0, (device, loss))

    def test_audit_detects_manipulated_counts(self):
        last = "idx = (SELECT max(idx) FROM record WHERE {}_frames > 0)"
        first = "idx = (SELECT min(idx) FROM record WHERE {}_frames > 0)"
        for statement, sensor in (
                ("UPDATE counter SET value = value + 1000000000 WHERE source = 'spd' AND name = 'tags'", "tdc"),
                (f"UPDATE record SET tags = tags + 1000000000 WHERE idx = {SLOTS // 2}", "tdc"),
                (f"UPDATE record SET spd_lost = spd_lost + 1000000000 WHERE idx = {SLOTS // 2}", "tdc"),
                ("UPDATE record SET radar_frames = radar_frames + 1 WHERE " + last.format("radar"), "radar"),
                ("UPDATE record SET depth_frames = depth_frames + 1 WHERE " + first.format("depth"), "depth"),
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
