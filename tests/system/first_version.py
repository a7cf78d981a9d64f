#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/first_version.py BIN_DIR: the run of the first packaged version, 0.1.0
(tests/golden/run-0.1.0.sqlite.gz: three slots of 0.2 s from a simulated laboratory), is refused, and what
scripts/convert_run makes of it opens with this version, says the same, and takes a note. The file is never made anew."""
import gzip
import json
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest
import zlib

bin_dir = pathlib.Path(sys.argv[1]).resolve()
root = pathlib.Path(__file__).resolve().parents[2]


class FirstVersion(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="echofuse-first-")
        self.dir = pathlib.Path(self.folder.name)
        self.run_file = self.dir / "first.sqlite"
        self.old = self.dir / "old.sqlite"
        self.old.write_bytes(gzip.decompress((root / "tests/golden/run-0.1.0.sqlite.gz").read_bytes()))

    def tearDown(self):
        self.folder.cleanup()

    def call(self, program, *words):
        done = subprocess.run([bin_dir / f"echofuse-{program}", *map(str, words)], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def convert(self, *words):
        return subprocess.run([sys.executable, root / "scripts/convert_run", *map(str, words)], capture_output=True, text=True)

    def test_refused(self):
        done = subprocess.run([bin_dir / "echofuse-acquire", "info", self.old], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("run format 1, expected 2; scripts/convert_run makes a run of this format", done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1)

    def test_columns(self):
        before = self.old.read_bytes()
        self.assertEqual(self.convert(self.old, self.run_file).returncode, 0)
        self.assertEqual(self.old.read_bytes(), before)
        self.assertIn("exists already", self.convert(self.old, self.run_file).stderr)
        self.assertIn("not a run of format 1", self.convert(self.run_file, self.dir / "again.sqlite").stderr)
        new = sqlite3.connect(self.run_file)
        new.execute("ATTACH ? AS old", (str(self.old),))
        for table, column, old in (("slot", "closed_late_s", "closed_late_s"), ("signal", "radar_snr_db", "radar_snr_db"),
                                   ("clock_fit", "spd_clock_drift_ppm", "spd_drift_ppm"), ("record", "spd", "spd"),
                                   ("record", "depth_verdict", "depth_verdict"), ("record", "slot_utc_ns", "slot_utc_ns")):
            same, = new.execute(f"SELECT count(*) FROM main.record n JOIN old.{table} o USING (idx) "
                                f"WHERE n.{column} = o.{old}").fetchone()
            rows, = new.execute(f"SELECT count({old}) FROM old.{table}").fetchone()
            self.assertEqual((same, rows > 0), (rows, True), column)
        depth, = new.execute("SELECT depth FROM main.record WHERE idx = 1").fetchone()
        png, = new.execute("SELECT depth FROM old.record WHERE idx = 1").fetchone()
        data = png[41:41 + int.from_bytes(png[33:37], "big")]
        rows = [row[1:] for row in (zlib.decompress(data)[k * 641:(k + 1) * 641] for k in range(240))]
        self.assertEqual(zlib.decompress(depth), b"".join(bytes([low, high]) for row in rows
                                                          for high, low in zip(row[::2], row[1::2])))

    def test_a_sensor_without_a_verdict(self):
        with sqlite3.connect(self.old) as old:
            old.execute("UPDATE record SET valid = 3, spd_verdict = NULL, depth_verdict = NULL")
        old.close()
        self.assertEqual(self.convert(self.old, self.run_file).returncode, 0)
        with sqlite3.connect(self.run_file) as new:
            self.assertEqual(new.execute("SELECT DISTINCT spd_verdict, depth_verdict FROM record").fetchall(), [("ok", "missing")])
        new.close()

    def test_run(self):
        self.assertEqual(self.convert(self.old, self.run_file).returncode, 0)
        info = json.loads(self.call("acquire", "info", "--json", self.run_file))
        self.assertEqual((info["version"], info["records"], info["status"], info["operator"], info["host"]),
                         ("0.1.0", 3, "complete", "Ada", "laboratory"))
        self.assertEqual((info["valid"], info["tags"]), ({"spd": 3, "radar": 3, "depth": 3}, 224836))
        self.assertEqual({axis["name"]: axis["count"] for axis in info["axes"]},
                         {"map_x": 64, "map_y": 64, "spd": 336, "radar": 64, "depth_x": 320, "depth_y": 240})
        self.call("export", self.run_file, "--to", self.dir / "first.h5x.h5")
        self.call("acquire", "annotate", self.run_file, "opened again")
        [entry] = json.loads(self.call("acquire", "list", "--json", self.dir))
        self.assertEqual(entry["notes"], ["opened again"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
