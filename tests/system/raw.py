#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/raw.py BIN_DIR: `run --keep-raw` beside a run, and `replay` of what it kept: the parsers
count the same, through faults and reconnections as well."""
import json
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest

bin_dir = pathlib.Path(sys.argv[1]).resolve()

FAULTS = """
[[fault]]
device = "tdc"
kind = "corrupt"
at_s = 0.5
for_s = 2
amount = 0.05
[[fault]]
device = "tdc"
kind = "unplug"
at_s = 3
for_s = 0.3
[[fault]]
device = "radar"
kind = "garbage"
at_s = 0.5
for_s = 2
amount = 40
[[fault]]
device = "radar"
kind = "unplug"
at_s = 3
for_s = 0.3
"""


class Raw(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="echofuse-")
        self.addCleanup(folder.cleanup)
        self.dir = pathlib.Path(folder.name)
        self.raw, self.run = self.dir / "raw", self.dir / "run.sqlite"

    def record(self, *lab, count):
        done = subprocess.run(
            [bin_dir / "echofuse-sim", "lab", "--dir", self.dir / "lab", "--window", "0.4", "--scene", "mixed", *lab, "--",
             bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--set", "run.window_s=0.4",
             "--out", self.run, "--count", str(count), "--keep-raw", self.raw],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60)
        self.log = done.stdout
        return done.returncode

    def query(self, text):
        with sqlite3.connect(f"file:{self.run}?mode=ro", uri=True) as db:
            return db.execute(text).fetchall()

    def counters(self, source):
        return dict(self.query(f"SELECT name, value FROM counter WHERE source = '{source}'"))

    def replay(self, device, pattern):
        files = sorted(self.raw.glob(pattern))
        self.assertTrue(files, [str(f) for f in self.raw.iterdir()])
        done = subprocess.run([bin_dir / "echofuse-acquire", "replay", "--json", f"--{device}", *files], check=True,
                              stdout=subprocess.PIPE, timeout=60)
        return len(files), json.loads(done.stdout)

    def compare(self, counted, replayed, names):
        self.assertEqual({name: replayed[name] for name in names}, {name: counted[name] for name in names}, self.log)

    def check_radar(self):
        counted = self.counters("radar")
        files, replayed = self.replay("radar", "radar-[0-9]*.dat")
        self.compare(counted, replayed, ["bytes", "frames", "range_profiles", "bad_headers", "bad_tlvs", "other_tlvs",
                                         "lost_frames", "restarts"])
        self.assertGreater(counted["frames"], 50)
        said = b"".join(f.read_bytes() for f in sorted(self.raw.glob("radar-cli-*.txt")))
        self.assertIn(b"sensorStart", said)
        self.assertIn(b"mmwDemo:/>", said)
        return files, counted

    def check_depth(self):
        counted = self.counters("depth")
        _, replayed = self.replay("depth", "depth-*.blocks")
        self.assertEqual(replayed["frames"], counted["frames"] + counted["dropped_frames"])
        self.assertEqual((replayed["lost_frames"], replayed["bad_payloads"], replayed["bad_crcs"]),
                         (counted["lost_frames"], 0, 0))
        self.assertEqual(replayed["model"], self.query("SELECT model FROM device WHERE sensor = 'depth'")[0][0])

    def test_the_same_counts(self):
        (self.dir / "faults.toml").write_text(FAULTS)
        self.assertEqual(self.record("--faults", self.dir / "faults.toml", count=20), 0, self.log)
        counted = self.counters("spd")
        files, replayed = self.replay("tdc", "tags-*.blocks")
        self.assertGreater(files, 1, self.log)
        self.assertGreater(counted["bad_crcs"], 0, self.log)
        self.compare(counted, replayed, ["bytes", "blocks", "junk_bytes", "bad_crcs", "bad_headers", "lost_blocks", "tags",
                                         "lost_items"])
        files, counted = self.check_radar()
        self.assertGreater(files, 1, self.log)
        self.assertGreater(counted["junk_bytes"], 0)
        self.check_depth()
        kept = sum(f.stat().st_size for f in self.raw.iterdir())
        self.assertIn(f"raw: {kept} bytes recorded in {self.raw}, 0 not recorded", self.log)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"Raw.{name}" for name in sys.argv[2:])])
