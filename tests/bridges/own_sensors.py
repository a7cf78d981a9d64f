#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""own_sensors.py BIN_DIR: tests recording, training and viewing with custom sensors.

The sensors are the bridges scripts/bridges/example.py and own_radar.py."""
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest

import testing
from testing import Client, Program, here, np, root, run_program

import bridge

PATH = f"{root}/scripts/bridges:{here}"
SLOTS = 60


def own(script):
    return Program(here / script, path=PATH)


class Example(unittest.TestCase):
    def test_example_bridge_has_at_most_60_lines(self):
        text = (root / "scripts/bridges/example.py").read_text(encoding="utf-8")
        self.assertLessEqual(text.count("\n"), 60)

    def test_example_bridge_checks_the_serial_number_and_sends_histograms(self):
        with Program("example.py", "--serial", "SIM-2") as program:
            self.assertEqual(program.process.wait(10), 4)
            self.assertIn("no board with the serial number SIM-2; attached: SIM-1", program.said())
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
        folder = tempfile.TemporaryDirectory(prefix="echofuse-")
        self.addCleanup(folder.cleanup)
        place = pathlib.Path(folder.name)
        with Program("example.py") as board, own("own_radar.py") as radar, \
                own("own_camera.py") as camera:
            config = "[run]\nwindow_s = 0.2\n"
            for table, sensor in (("tdc", board), ("radar", radar), ("depth", camera)):
                config += '[%s]\naddress = "bridge:tcp://%s:%d"\n' % (table, *sensor.address)
            (place / "lab.toml").write_text(config, encoding="utf-8")
            run_program("echofuse-acquire", "run", "--config", place / "lab.toml", "--out",
                             place / "run", "--count", SLOTS, "--keep-raw", place / "raw")
        complete = self.check_run(place / "run.sqlite")
        for command in (("echofuse-recon", "train", place / "run.sqlite", "--model", "ridge",
                         "--out", place / "model", "-q"),
                        ("echofuse-recon", "reconstruct", place / "model", place / "run.sqlite",
                         "--out", place / "maps", "-q"),
                        ("echofuse-acquire", "import", place / "raw", "--out", place / "again")):
            # Code 5: a record lacks a sensor, because a process was starved.
            run_program(*command, ok=(0, 5) if "reconstruct" in command else (0,))
        self.assertGreaterEqual(len(list((place / "maps").glob("*.png"))), complete)
        with sqlite3.connect(place / "run.sqlite") as live, \
                sqlite3.connect(place / "again.sqlite") as again:
            query = "SELECT spd, radar FROM record WHERE valid = 7 ORDER BY idx LIMIT 40"
            self.assertEqual(again.execute(query).fetchall(), live.execute(query).fetchall())
        self.assertIn("R1", run_program("echofuse-acquire", "info", place / "run.sqlite"))

    def check_run(self, path):
        with sqlite3.connect(path) as db:
            axes = dict((row[0], row[1:]) for row in db.execute(
                "SELECT name, quantity, unit, count, start, step FROM axis"))
            self.assertEqual(axes["spd"], ("counts", "ps", 336, 13343, 100))
            self.assertEqual(axes["radar"][:3], ("power", "m", 80))
            self.assertEqual(db.execute("SELECT sensor, model, serial FROM device ORDER BY sensor")
                             .fetchall(), [("depth", "Own camera", "C1"),
                                           ("radar", "Own radar", "R1"),
                                           ("spd", "Simulated board", "SIM-1")])
            rows = db.execute("SELECT spd, radar FROM record WHERE valid = 7").fetchall()
            starts = db.execute("SELECT DISTINCT starts % 50000 FROM record").fetchall()
        self.assertGreater(len(rows), 0.8 * SLOTS)
        self.assertEqual(starts, [(0,)])
        near = 0
        for spd, radar in rows:
            spd, radar = np.frombuffer(spd, "<u4"), np.frombuffer(radar, "<f4")
            near += abs(2 + 0.015 * np.argmax(spd) - 0.1 * np.argmax(radar)) < 0.3
        self.assertGreater(near, 0.9 * len(rows))
        return len(rows)


if __name__ == "__main__":
    testing.main()
