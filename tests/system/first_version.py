#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/first_version.py BIN_DIR: the run of the first packaged version, 0.1.0
(tests/golden/run-0.1.0.sqlite.gz: three slots of 0.2 s from a simulated laboratory), opens with this version, says the
same, and takes a note. The file is never made anew."""
import gzip
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

bin_dir = pathlib.Path(sys.argv[1]).resolve()
golden = pathlib.Path(__file__).resolve().parents[1] / "golden"


class FirstVersion(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="echofuse-first-")
        self.dir = pathlib.Path(self.folder.name)
        self.run_file = self.dir / "first.sqlite"
        self.run_file.write_bytes(gzip.decompress((golden / "run-0.1.0.sqlite.gz").read_bytes()))

    def tearDown(self):
        self.folder.cleanup()

    def call(self, program, *words):
        done = subprocess.run([bin_dir / f"echofuse-{program}", *map(str, words)], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_run(self):
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
