#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that importing a raw capture gives the same records as the live run with --keep-raw, even after faults and
reconnections. Called as `tests/system/raw.py BIN_DIR`."""
import re
import sqlite3
import subprocess

from case import Case, bin_dir, main

COLUMNS = "SELECT idx, slot_start_ns, closed_late_s, valid, tags, in_range, spd_verdict, radar_verdict, radar_used, spd, radar, depth FROM record"

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


class Raw(Case):
    def setUp(self):
        super().setUp()
        self.raw, self.run = self.dir / "raw", self.dir / "run.sqlite"

    def record(self, *lab, count):
        # The run is paused for several slots, as on a busy machine: its slots are closed late, after their deadlines.
        paused = '"$@" & sleep 5; kill -STOP $!; sleep 1.5; kill -CONT $!; wait $!'
        done = subprocess.run(
            [bin_dir / "echofuse-sim", "lab", "--dir", self.dir / "lab", "--window", "0.4", "--scene", "mixed", *lab, "--",
             "sh", "-c", paused, "sh", bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml",
             "--set", "run.window_s=0.4", "--out", self.run, "--count", str(count), "--keep-raw", self.raw],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60)
        self.log = done.stdout
        return done.returncode

    def query(self, text):
        with sqlite3.connect(f"file:{self.run}?mode=ro", uri=True) as db:
            return db.execute(text).fetchall()

    def counters(self, source):
        """Returns the counters of a source, leaving out totals, because a live run continues to read until its file
        is closed."""
        return dict(self.query(f"SELECT name, value FROM counter WHERE source = '{source}' AND name NOT IN "
                               "('bytes', 'blocks', 'frames', 'frame_bytes', 'range_profiles', 'arrays', 'tags', 'outside')"))

    def test_import_of_a_raw_capture_gives_the_records_of_the_live_run(self):
        (self.dir / "faults.toml").write_text(FAULTS)
        self.assertEqual(self.record("--faults", self.dir / "faults.toml", count=20), 0, self.log)
        kept = sum(f.stat().st_size for f in self.raw.iterdir())
        self.assertIn(f"raw: {kept} bytes recorded in {self.raw}, 0 not recorded", self.log)
        said = b"".join(f.read_bytes() for f in sorted(self.raw.glob("radar-cli-*.txt")))
        self.assertIn(b"sensorStart", said)
        self.assertIn(b"mmwDemo:/>", said)
        for device in "tags-*.blocks", "radar-[0-9]*.dat":
            self.assertGreater(len(list(self.raw.glob(device))), 1, self.log)
        live = self.query(COLUMNS), self.counters("spd"), self.counters("radar")
        self.assertGreater(live[1]["bad_crcs"], 0, self.log)
        self.assertGreater(live[2]["junk_bytes"], 0)
        self.run = self.dir / "again.sqlite"
        subprocess.run([bin_dir / "echofuse-acquire", "import", self.raw, "--out", self.run, "-q"], check=True, timeout=60)
        self.assertEqual((self.query(COLUMNS), self.counters("spd"), self.counters("radar")), live, self.log)
        # Import must reject a damaged slot length, for example 400 s or 1 ns.
        times = (self.raw / "run.times").read_text()
        for length in "400000000000", "4000000000000000000", "-400000000", "1":
            (self.raw / "run.times").write_text(re.sub(r"( slots )\d+", rf"\g<1>{length}", times))
            done = subprocess.run([bin_dir / "echofuse-acquire", "import", self.raw, "--out", self.dir / "other"],
                                  capture_output=True, text=True, timeout=20)
            self.assertEqual(done.returncode, 1, done.stderr)
            self.assertIn("check whether a number is damaged", done.stderr)


if __name__ == "__main__":
    main(Raw)
