#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""end_to_end.py BIN_DIR: tests that the daemon records every tag and every pixel sent by the
bridges.

The bridges use stand-ins for the vendors' libraries."""
import csv
import pathlib
import re
import sqlite3
import struct
import subprocess
import sys
import tempfile
import unittest

import testing
from testing import Program, np

import pyorbbecsdk as sdk
import TimeTagger as library

daemon_program = pathlib.Path(sys.argv[1]) / "echofuse-acquire"
SLOTS = 10


class Recording(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="echofuse-")
        self.addCleanup(folder.cleanup)
        self.dir = pathlib.Path(folder.name)

    def record(self, bridge, key, enough):
        """Records a run with slots of 0.2 s. Returns the rows of the run and the daemon's log.

        Stops the bridge after `enough` rows, so that the bridge prints the number of items sent."""
        config = self.dir / "lab.toml"
        address = "bridge:tcp://%s:%d" % bridge.address
        table, name = key.split(".")
        config.write_text(f'[run]\nwindow_s = 0.2\n[{table}]\n{name} = "{address}"\n', encoding="utf-8")
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
            with sqlite3.connect(f"file:{self.dir}/run.sqlite?mode=ro", uri=True) as db:
                db.row_factory = sqlite3.Row
                return db.execute("SELECT * FROM record ORDER BY idx").fetchall()
        except sqlite3.OperationalError:
            return []

    def device(self):
        with sqlite3.connect(f"file:{self.dir}/run.sqlite?mode=ro", uri=True) as db:
            return db.execute("SELECT sensor, model, serial, firmware FROM device").fetchall()

    def test_run_contains_every_tag_that_the_bridge_sent(self):
        with Program("timetagger.py", STAND_IN_PULSES_PER_S="200000") as bridge:
            rows, log = self.record(bridge, "tdc.address", enough=5)
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
            rows, log = self.record(bridge, "depth.address", enough=5)
            sent, clients, dropped = bridge.sent()
        self.assertEqual((clients, dropped), (1, 0))
        arrived = int(re.search(r"(\d+) depth frames", log).group(1))
        self.assertEqual(arrived, sent)
        self.assertEqual(self.device(), [("depth", "Orbbec Gemini 2", "STAND-IN-2", "1.4.98")])
        for row in rows[1:4]:
            self.assertEqual((row["valid"], row["depth_lost"]), (4, 0), row["depth_verdict"])
            depth, x, y = self.export(row["idx"])
            # The value of the first pixel encodes the frame number, modulo 5000.
            fitting = [n for n in range(5000) if (7 * n) % 5000 + 500 == depth[0]]
            np.testing.assert_array_equal(depth, sdk.values(fitting[0], 64 * 64))
            np.testing.assert_allclose(x[:64], (np.arange(64) - 31.5) / 50, rtol=1e-6)
            np.testing.assert_allclose(y[::64], (31.5 - np.arange(64)) / 50, rtol=1e-6)

    def export(self, index):
        path = self.dir / f"{index}.csv"
        subprocess.run([daemon_program.with_name("echofuse-export"), self.dir / "run.sqlite", "--record", str(index), "--to", path],
                       check=True, stderr=subprocess.DEVNULL)
        with open(path, encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if row[0] == "depth"]
        x, y, z = zip(*[row[1:] for row in rows])
        return np.array(z, int), np.array(x, float), np.array(y, float)


if __name__ == "__main__":
    testing.main()
