#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/doctor.py BIN_DIR TEST: `doctor` on the simulated laboratory, well and ill."""
import json
import os
import re
import subprocess
import sys
import unittest

import live


class Doctor(live.Live):
    def examine(self, *options, json_wanted=True):
        env = os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")}
        done = subprocess.run([live.bin_dir / "echofuse-acquire", "doctor", "--config", self.dir / "lab/lab.toml", "--set",
                               f"run.folder={self.run.parent}", *(["--json"] if json_wanted else []), *options], env=env, text=True,
                              capture_output=True, timeout=50)
        if not json_wanted:
            return done
        self.assertTrue(done.stdout, done.stderr)
        report = json.loads(done.stdout)
        self.assertEqual(report["exit_code"], done.returncode)
        checks = {}
        for check in report["checks"]:  # complaints come behind the check of their device
            checks.setdefault(check["check"], check)
        return done.returncode, checks

    def test_well(self):
        code, checks = self.examine("--duration", f"{4000 * live.WINDOW_S}s", "--set", "depth.fps=30")
        self.assertEqual(code, 0, checks)
        self.assertEqual({name: checks[name]["grade"] for name in ("spd", "radar", "disk space")},
                         {"spd": "ok", "radar": "ok", "disk space": "ok"}, checks)
        spd, radar, depth = (checks[name]["facts"] for name in ("spd", "radar", "depth"))
        self.assertGreater(spd["starts_per_s"], 1000)
        self.assertGreater(spd["share_in_range"], 0.5)
        self.assertEqual(spd["lost_tags"] + spd["lost_blocks"], 0)
        self.assertEqual(radar["nominal_frames_per_s"], 20)
        self.assertAlmostEqual(radar["frames_per_s"], 20, delta=2)
        self.assertEqual(radar["bins"], 64)
        self.assertGreater(radar["peak_over_median_db"], 3)
        self.assertAlmostEqual(depth["frames_per_s"], 30, delta=3)
        self.assertGreater(depth["valid_share"], 0)
        self.assertGreater(checks["disk rate"]["facts"]["bytes_per_s"], checks["disk rate"]["facts"]["needed_bytes_per_s"])
        self.assertFalse(list(self.dir.glob("*.sqlite*")) + list(self.dir.glob(".echofuse*")))

    def test_complaints(self):
        """What a driver says of its device follows the device's line, and is a warning only."""
        [cfg] = re.findall(r'(?m)^cfg = "(.*)"', (self.dir / "lab/lab.toml").read_text())
        changed = re.sub(r"(?m)^clutterRemoval -1 0", "clutterRemoval -1 1", (self.dir / "lab" / cfg).read_text())
        (self.dir / "changed.cfg").write_text(changed)
        done = self.examine("--set", f"radar.cfg={self.dir}/changed.cfg", json_wanted=False)
        self.assertEqual(done.returncode, 0, done.stdout)
        lines = done.stdout.splitlines()
        at = next(k for k, line in enumerate(lines) if line.split()[1] == "radar")  # a busy machine may miss frames
        self.assertTrue(lines[at + 1].startswith("warning  radar"), done.stdout)
        self.assertIn("clutterRemoval 1 removes", lines[at + 1])

    def test_ill(self):
        """Swapped channels, a radar that is not there, more records than the disk holds: all told, in lines."""
        done = self.examine("--duration", f"{10**12 * live.WINDOW_S}s", "--set", "tdc.start_channel=7", "--set",
                            f"radar.cli=serial:{self.dir}/none", "--set", "run.connect_timeout_s=2", json_wanted=False)
        self.assertEqual(done.returncode, 4, done.stdout)
        lines = done.stdout.splitlines()
        self.assertTrue(all(line.split()[0] in ("ok", "warning", "problem") for line in lines), done.stdout)

        def line(begin):
            return next((line for line in lines if line.startswith(begin)), "nothing begins so:\n" + done.stdout)
        self.assertIn("no starts on tdc.start_channel = 7", line("problem  spd"))
        self.assertIn("the channels with tags are 1 (", line("problem  spd"))
        self.assertIn("none: No such file", line("problem  permissions"))
        self.assertIn(f"radar serial:{self.dir}/none: ", line("problem  radar"))
        self.assertIn("free some space", line("problem  disk space"))
        self.assertIn("valid", line("ok       depth") + line("warning  depth"))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"Doctor.{name}" for name in sys.argv[2:])])
