#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""audit.py VIRTUAL_RUN: tests that scripts/audit_run.py detects manipulated counts in a run that was recorded with faults."""
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

import soak
from fixtures import change

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
        self.assertEqual((code, account["unexplained"], account["run"]["records"]), (0, [], SLOTS))
        for device, loss in (("tdc", "not delivered: dropped"), ("radar", "counted as lost"), ("depth", "counted as lost")):
            self.assertGreater(account[device].get(loss, 0), 0, (device, loss))

    def test_audit_detects_manipulated_counts(self):
        for name, values, sensor in (
                ("counter ?2 of ?1 is higher by ?3", ("spd", "tags", 10 ** 9), "tdc"),
                ("counter ?2 of ?1 is higher by ?3", ("depth", "early", 1), "depth"),
                ("tags of record ?1 are higher by ?2", (SLOTS // 2, 10 ** 9), "tdc"),
                ("lost SPD data of record ?1 are higher by ?2", (SLOTS // 2, 10 ** 9), "tdc"),
                ("one more radar frame in the last record with frames", (), "radar"),
                ("one more depth frame in the first record with frames", (), "depth"),
                ("one more lost depth frame in the last record with frames", (), "depth")):
            copy = self.dir / "falsified.sqlite"
            shutil.copy(self.dir / "run.sqlite", copy)
            self.assertEqual(change(copy, name, *values), 1, name)
            code, account = self.audit(copy)
            self.assertEqual(code, 1, name)
            self.assertIn(sensor + ":", " ".join(account["unexplained"]), name)


unittest.main(argv=sys.argv[:1] + sys.argv[2:])
