#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests that the daemon records every tag and every pixel sent by the bridges, which use stand-ins for the vendors' libraries.
Also tests runs with custom sensors."""
import pathlib
import sqlite3
import struct
import subprocess
import sys
import tempfile
import unittest

import testing
from testing import Program, here, np, root, run_program
import echofuse
import fixtures
from recorder import values
import TimeTagger as library


daemon_program = pathlib.Path(sys.argv[1]) / "echofuse-acquire"
SLOTS = 10


class Recording(unittest.TestCase):
    def setUp(self):
        self.dir = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(prefix="echofuse-")))

    def record(self, bridge, table, enough):
        """Records a run. Stops the bridge after `enough` rows, so that the bridge prints the number of items sent. Returns
        the rows of the run and the daemon's log."""
        config = testing.config(self.dir / "lab.toml", **{table: bridge})
        daemon = subprocess.Popen([daemon_program, "run", "--config", config, "--out", self.dir / "run", "--count",
                                   str(SLOTS)], stderr=subprocess.PIPE, text=True)
        self.addCleanup(lambda: daemon.poll() is None and daemon.kill())
        try:
            testing.wait_for("records", lambda: len(self.rows()) >= enough)
        except AssertionError:
            daemon.kill()
            self.fail(daemon.communicate()[1] + bridge.said())
        self.assertEqual(bridge.stop(), 0)
        log = daemon.communicate(timeout=20)[1]
        self.assertEqual(daemon.returncode, 0, log)
        return self.rows(), log

    def rows(self):
        try:
            return fixtures.query(self.dir / "run.sqlite", "SELECT * FROM record ORDER BY idx", by_name=True)
        except sqlite3.OperationalError:
            return []

    def device(self):
        return fixtures.query(self.dir / "run.sqlite", "SELECT sensor, model, serial, firmware FROM device")

    def test_run_contains_every_tag_that_the_bridge_sent(self):
        with Program("timetagger.py", STAND_IN_PULSES_PER_S="200000") as bridge:
            rows, log = self.record(bridge, "tdc", enough=5)
            sent, clients, dropped = bridge.sent()
        self.assertEqual((clients, dropped), (1, 0))
        self.assertIn(f"received: {sent} tags", log)
        self.assertEqual(self.device(), [("spd", "Time Tagger Ultra", "STAND-IN-1",
                                          "Version: 2 FPGA: 10; trigger levels 1: 0.5 V, 2: 0.5 V")])
        self.assertEqual([row["idx"] for row in rows], list(range(SLOTS)))
        full = rows[1:4]
        for row in full:
            self.assertEqual(row["valid"], 1, row["spd_verdict"])
            # Slots may end within a pattern of the stand-in, so counts may differ by one.
            patterns = row["starts"] / library.PULSES
            self.assertGreater(patterns, 1)
            self.assertEqual(row["tags"], row["starts"] + row["in_range"] + row["other"])
            self.assertLessEqual(abs(row["in_range"] - patterns * library.CLICKS), 1)
            self.assertLessEqual(abs(row["other"] - patterns * 3), 3)
            self.assertLessEqual(abs(row["spd_lost"] - patterns * library.MISSED), library.MISSED)
            counts = np.array(struct.unpack(f"<{len(row['spd']) // 4}I", row["spd"]))
            expected = np.zeros(336)
            clicks = 20000 + 100 * (np.arange(0, library.PULSES, 2) % 200)
            np.add.at(expected, (clicks - 13343) // 100, patterns)
            np.testing.assert_allclose(counts, expected, atol=2)
            np.testing.assert_array_equal(counts[expected == 0], 0)
        self.assertNotIn("arrived after their slot", log)

    def test_run_contains_every_depth_pixel_that_the_bridge_sent(self):
        with Program("orbbec.py", "--width", "64", "--height", "64") as bridge:
            rows, log = self.record(bridge, "depth", enough=5)
            sent, clients, dropped = bridge.sent()
        self.assertEqual((clients, dropped), (1, 0))
        self.assertIn(f" {sent} depth frames", log)
        self.assertEqual(self.device(), [("depth", "Orbbec Gemini 2", "STAND-IN-2", "1.4.98")])
        run = echofuse.open(self.dir / "run")
        np.testing.assert_allclose(run.axes["depth_x"].values, (np.arange(64) - 31.5) / 50, rtol=1e-6)
        np.testing.assert_allclose(run.axes["depth_y"].values, (31.5 - np.arange(64)) / 50, rtol=1e-6)
        for row in rows[1:4]:
            self.assertEqual((row["valid"], row["depth_lost"]), (4, 0), row["depth_verdict"])
            depth = run.depth_mm(row["idx"]).ravel()
            # The value of the first pixel encodes the frame number, modulo 5000.
            fitting = [n for n in range(5000) if (7 * n) % 5000 + 500 == depth[0]]
            np.testing.assert_array_equal(depth, values(fitting[0], 64 * 64))


PATH = f"{root}/scripts/bridges:{here}"
CUSTOM_SLOTS = 60


class Example(unittest.TestCase):
    def test_example_bridge_has_at_most_60_lines(self):
        text = (root / "scripts/bridges/example.py").read_text(encoding="utf-8")
        self.assertLessEqual(text.count("\n"), 60)

    def test_example_bridge_checks_the_serial_number(self):
        self.assertIn("no board with the serial number SIM-2; attached: SIM-1", testing.ended("example.py", "--serial", "SIM-2"))

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


class CustomSensors(unittest.TestCase):
    def test_data_of_custom_sensors_can_be_recorded_displayed_and_used_for_training(self):
        place = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(prefix="echofuse-")))
        with Program("example.py", "--serial", "SIM-1") as board, \
                Program(here / "own_devices.py", "radar", path=PATH) as radar, \
                Program(here / "own_devices.py", "camera", path=PATH) as camera:
            config = testing.config(place / "lab.toml", tdc=board, radar=radar, depth=camera)
            run_program("echofuse-acquire", "run", "--config", config, "--out", place / "run", "--count", CUSTOM_SLOTS,
                        "--keep-raw", place / "raw")
        complete = self.check_run(place / "run.sqlite")
        run_program("echofuse-recon", "train", place / "run.sqlite", "--model", "ridge", "--out", place / "model", "-q")
        # Code 5: a record lacks a sensor, because a process was starved.
        run_program("echofuse-recon", "reconstruct", place / "model", place / "run.sqlite", "--out", place / "maps", "-q", ok=(0, 5))
        self.assertGreaterEqual(len(list((place / "maps").glob("*.png"))), complete)
        run_program("echofuse-acquire", "import", place / "raw", "--out", place / "again")
        live, again = (fixtures.query(place / f"{run}.sqlite", "SELECT spd, radar FROM record WHERE valid = 7 ORDER BY idx LIMIT 40")
                       for run in ("run", "again"))
        self.assertEqual(again, live)
        self.assertIn("R1", run_program("echofuse-acquire", "info", place / "run.sqlite"))

    def check_run(self, path):
        axes = {row[0]: row[1:] for row in fixtures.query(path, "SELECT name, quantity, unit, count, start, step FROM axis")}
        self.assertEqual((axes["spd"], axes["radar"][:3]), (("counts", "ps", 336, 13343, 100), ("power", "m", 80)))
        self.assertEqual(fixtures.query(path, "SELECT sensor, model, serial FROM device ORDER BY sensor"), [
            ("depth", "Own camera", "C1"), ("radar", "Own radar", "R1"), ("spd", "Simulated board", "SIM-1")])
        rows = fixtures.query(path, "SELECT spd, radar FROM record WHERE valid = 7")
        starts = fixtures.query(path, "SELECT DISTINCT starts % 50000 FROM record")
        self.assertGreater(len(rows), 0.8 * CUSTOM_SLOTS)
        self.assertEqual(starts, [(0,)])
        near = 0
        for spd, radar in rows:
            spd, radar = np.frombuffer(spd, "<u4"), np.frombuffer(radar, "<f4")
            near += abs(2 + 0.015 * np.argmax(spd) - 0.1 * np.argmax(radar)) < 0.3
        self.assertGreater(near, 0.9 * len(rows))
        return len(rows)


testing.main()
