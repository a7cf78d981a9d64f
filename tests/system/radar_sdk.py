#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/radar_sdk.py BIN_DIR: radars with firmware of each SDK, and the cfgs that are shipped."""
import pathlib
import subprocess
import sys
import tempfile
import unittest

bin_dir = pathlib.Path(sys.argv[1]).resolve()
cfgs = pathlib.Path(__file__).resolve().parent.parent.parent / "config/radar"


def devices(sdk, cfg):
    """`devices` on a laboratory whose radar has this SDK: its exit code and what it says of the radar."""
    with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
        lab = pathlib.Path(folder) / "lab"
        done = subprocess.run(
            [bin_dir / "echofuse-sim", "lab", "--dir", lab, "--radar-sdk", sdk, *(["--radar-cfg", cfg] if cfg else []),
             "--", bin_dir / "echofuse-acquire", "devices", "--config", lab / "lab.toml", "--set", "run.connect_timeout_s=5",
             "--set", "tdc.address=", "--set", "depth.address="], capture_output=True, text=True, timeout=60)
        return done.returncode, next((line for line in done.stdout.splitlines() if line.startswith("radar")),
                                     done.stdout + done.stderr)


class Sdk(unittest.TestCase):
    def test_each_with_its_own(self):
        for sdk in ("3.4", "3.5", "3.6"):
            code, line = devices(sdk, None)
            self.assertEqual(code, 0, line)
            self.assertIn(f"firmware mmWave SDK 0{sdk.replace('.', '.0')}.", line)

    def test_the_other(self):
        code, line = devices("3.4", cfgs / "xwr68xx_44mm.cfg")
        self.assertEqual(code, 4, line)
        self.assertRegex(line, r"radar\.cfg:\d+: calibData 0 0 0: .*SDK 3\.5 and 3\.6 know this command, this radar has mmWave "
                               r"SDK 03\.04\.\S+: use a cfg for SDK 3\.4, config/radar/\S+_sdk3\.4\.cfg")
        code, line = devices("3.5", cfgs / "xwr68xx_44mm_sdk3.4.cfg")
        self.assertEqual(code, 4, line)
        self.assertRegex(line, r"radar\.cfg:\d+: sensorStart: .*the cfg is for SDK 3\.4.*use a cfg for SDK 3\.5, config/radar/")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[2:])
