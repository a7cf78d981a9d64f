#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""own_sensors.py BIN_DIR: tests recording, training and viewing with custom sensors.

The sensors are the bridges scripts/bridges/example.py and own_radar.py."""
import pathlib
import subprocess
import sys
import tempfile
import unittest

import testing
from testing import Client, Program, here, np, root, run_program

import bridge
from fixtures import query

PATH = f"{root}/scripts/bridges:{here}"
SLOTS = 60


def own(script):
    return Program(here / script, path=PATH)


class Example(unittest.TestCase):
    def test_example_bridge_has_at_most_60_lines(self):
        text = (root / "scripts/bridges/example.py").read_text(encoding="utf-8")
        self.assertLessEqual(text.count("\n"), 60)

    def test_example_bridge_checks_the_serial_number_and_sends_histograms(self):
        self.assertIn("no board with the serial number SIM-2; attached: SIM-1", testing.ended("example.py", "--serial", "SIM-2"))
        with Program("example.py") as program, Client(program.address) as client:
            blocks = client.until(bridge.HISTOGRAM)
            self.assertIn(b'"sends": "histograms"', blocks[0].payload)
            self.assertEqual(len(blocks[-1].payload), 44 + 4 * 336)
            self.assertEqual(program.stop(), 0)

    def test_example_bridge_reopens_an_unplugged_device(self):
        code = ("import sys; sys.argv = ['example.py', '--listen', '127.0.0.1:0']; import example\n"
                "def unplugged(board, server, once=[]):\n"
                "    if once: return 0.01\n"
                "    once.append(1); raise RuntimeError('unplugged')\n"
                "example.Board.poll = unplugged\n"
                "example.bridge.reopen = lambda opened, stop: print('again', flush=True) or None\n"
                "example.main()")
        done = subprocess.run([sys.executable, "-c", code], env={"PYTHONPATH": PATH},
                              capture_output=True, text=True, timeout=20)
        self.assertIn("unplugged; trying again", done.stderr)
        self.assertEqual(done.stdout, "again\n")


class Recording(unittest.TestCase):
    def test_data_of_custom_sensors_can_be_recorded_displayed_and_used_for_training(self):
        place = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(prefix="echofuse-")))
        with Program("example.py") as board, own("own_radar.py") as radar, own("own_camera.py") as camera:
            run_program("echofuse-acquire", "run", "--config", testing.config(place / "lab.toml", tdc=board, radar=radar, depth=camera),
                        "--out", place / "run", "--count", SLOTS, "--keep-raw", place / "raw")
        complete = self.check_run(place / "run.sqlite")
        run_program("echofuse-recon", "train", place / "run.sqlite", "--model", "ridge", "--out", place / "model", "-q")
        # Code 5: a record lacks a sensor, because a process was starved.
        run_program("echofuse-recon", "reconstruct", place / "model", place / "run.sqlite", "--out", place / "maps", "-q", ok=(0, 5))
        self.assertGreaterEqual(len(list((place / "maps").glob("*.png"))), complete)
        run_program("echofuse-acquire", "import", place / "raw", "--out", place / "again")
        live, again = (query(place / f"{run}.sqlite", "SELECT spd, radar FROM record WHERE valid = 7 ORDER BY idx LIMIT 40")
                       for run in ("run", "again"))
        self.assertEqual(again, live)
        self.assertIn("R1", run_program("echofuse-acquire", "info", place / "run.sqlite"))

    def check_run(self, path):
        axes = {row[0]: row[1:] for row in query(path, "SELECT name, quantity, unit, count, start, step FROM axis")}
        self.assertEqual((axes["spd"], axes["radar"][:3]), (("counts", "ps", 336, 13343, 100), ("power", "m", 80)))
        self.assertEqual(query(path, "SELECT sensor, model, serial FROM device ORDER BY sensor"), [
            ("depth", "Own camera", "C1"), ("radar", "Own radar", "R1"), ("spd", "Simulated board", "SIM-1")])
        rows = query(path, "SELECT spd, radar FROM record WHERE valid = 7")
        starts = query(path, "SELECT DISTINCT starts % 50000 FROM record")
        self.assertGreater(len(rows), 0.8 * SLOTS)
        self.assertEqual(starts, [(0,)])
        near = 0
        for spd, radar in rows:
            spd, radar = np.frombuffer(spd, "<u4"), np.frombuffer(radar, "<f4")
            near += abs(2 + 0.015 * np.argmax(spd) - 0.1 * np.argmax(radar)) < 0.3
        self.assertGreater(near, 0.9 * len(rows))
        return len(rows)


testing.main()
