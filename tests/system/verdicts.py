#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/verdicts.py BIN_DIR [TEST]: what the daemon thinks of its sensors' signals, and that a laboratory's
scenes keep to its slots."""
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

import live
from live import WINDOW_S, bin_dir


class Verdicts(live.Live):
    def setUp(self):
        pass  # each test opens a laboratory of its own

    def open_lab(self, *options):
        self.lab_options = ("--hold", str(WINDOW_S), "--laser-rate-hz", "2e7", "--set", "signal_photons=5e4", *options)
        super().setUp()

    def file(self, text):
        folder = tempfile.TemporaryDirectory(prefix="echofuse-")
        self.addCleanup(folder.cleanup)
        path = pathlib.Path(folder.name) / "file.toml"
        path.write_text(text)
        return path

    def kinds(self, sensor):
        return [row[sensor + "_verdict"].split(":")[0] for row in self.rows()]

    def test_weak(self):
        """A laser a thousand times weaker, from the start."""
        self.open_lab("--set", "signal_photons=100")
        daemon = self.record("--count", "6", "--strict")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 5, log)
        self.assertIn("6 with a sensor not ok", log)
        self.assertEqual(self.kinds("spd"), ["weak"] * 6, log)
        self.assertEqual(log.count("warning spd: record 0: weak: "), 1, log)
        self.assertEqual(log.count("weak: "), 1, log)
        info = self.info()
        self.assertEqual(info["verdicts"], {"spd": {"weak": 6}, "radar": {"ok": 6}, "depth": {"ok": 6}})
        self.assertEqual(info["valid"]["spd"], 6)
        text = subprocess.run([bin_dir / "echofuse-acquire", "info", self.run], stdout=subprocess.PIPE, text=True).stdout
        self.assertIn("spd: weak 6", text)

    def test_failing(self):
        """A laser that fades, then a camera and a radar that freeze: each told as it begins and ends."""
        begin = 3.5  # s: until then the devices are up and there are enough records to compare with
        faults = [("tdc", "gain", begin), ("depth", "freeze", begin + 2), ("radar", "freeze", begin + 4)]
        scenario = self.file("".join(
            f'[[fault]]\ndevice = "{d}"\nkind = "{k}"\nat_s = {at}\nfor_s = 1.2\n' +
            ("amount = 0.03\n" if k == "gain" else "") for d, k, at in faults))
        self.open_lab("--faults", scenario)
        daemon = self.record("--duration", "9s", "--set", "signal.spd_clicks=0", "--set", "signal.clicks_a_pulse=0")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        for sensor, kind in ("spd", "weak"), ("depth", "stands still"), ("radar", "stands still"):
            self.assertRegex(log, rf"warning {sensor}: record \d+: {kind}: ")
            self.assertRegex(log, rf"info {sensor}: record \d+: ok")
            # No frames, of a busy machine, is none of the faults.
            bad = [k for k, found in enumerate(self.kinds(sensor)) if found not in ("ok", "no frames")]
            self.assertGreaterEqual(len(bad), 3, log)
            self.assertEqual(bad, list(range(bad[0], bad[-1] + 1)), log)
            self.assertEqual({self.kinds(sensor)[k] for k in bad}, {kind})

    def test_one_scene_a_slot(self):
        """Bodies at 3 and 4 m in turns, each for one slot: no record sees both."""
        scenes = self.file("".join(f'[[scene]]\nkind = "person"\nx_m = 0.0\nz_m = {z}\nyaw_deg = 0.0\n'
                                   for z in (3.0, 4.0)))
        self.open_lab("--set", f"scenes={scenes}")
        daemon = self.record("--count", "15", "--strict")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)  # nor is a filtered sync taken for saturation
        border = round((3.5 * 2 / 0.299792458e-3 - 13343) / 100)
        near = []
        for row in self.rows():
            counts = struct.unpack(f"<{len(row['spd']) // 4}I", row["spd"])
            near.append(sum(counts[:border]) / sum(counts))
        # Until the tagger's clock is known, its tags are placed by their receipt, some ms late.
        self.assertTrue(all(min(share, 1 - share) < 0.05 for share in near[5:]), near)
        self.assertTrue(all((a > 0.5) != (b > 0.5) for a, b in zip(near, near[1:])), near)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"Verdicts.{name}" for name in sys.argv[2:])])
