#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that importing a raw capture gives the same records as the live run with --keep-raw, even after faults and
reconnections, and with an emulated USB time tagger."""
import json
import os
import re
import subprocess

from case import Case, bin_dir, main, source
import fixtures

RECORDS = """SELECT idx, slot_start_ns, closed_late_s, valid, tags, in_range, spd_verdict, radar_verdict, radar_used, spd,
             radar, depth, array_frames, array FROM record"""
# Totals of received data are excluded, because a live run continues to read until its file is closed.
COUNTERS = """SELECT source, name, value FROM counter WHERE source IN ('spd', 'radar') AND name NOT IN
              ('bytes', 'blocks', 'frames', 'frame_bytes', 'range_profiles', 'arrays', 'tags', 'outside')"""
FAULTS = "".join(f'[[fault]]\ndevice = "{device}"\nkind = "{kind}"\nat_s = {at_s}\nfor_s = {for_s}\n{amount}\n' for device, kind, at_s, for_s, amount in (
    ("tdc", "corrupt", 0.5, 2, "amount = 0.05"), ("tdc", "unplug", 3, 0.3, ""),
    ("radar", "garbage", 0.5, 2, "amount = 40"), ("radar", "unplug", 3, 0.3, "")))
# With the emulated tagger, the number of photons per slot is constant, so longer slots reduce the number of tags per second.
USB_WINDOW_S = float(os.environ.get("ECHOFUSE_TEST_WINDOW_S", "0.5"))


class Raw(Case):
    def setUp(self):
        super().setUp()
        self.raw, self.run, self.again = self.dir / "raw", self.dir / "run.sqlite", self.dir / "again.sqlite"

    def record(self, count, window_s, *front, **how):
        """Records a run with --keep-raw, and imports the capture again. Returns the log of the run."""
        done = self.lab(*front, bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--set", f"run.window_s={window_s}",
                        "--out", self.run, "--count", count, "--keep-raw", self.raw, **how)
        self.assertEqual(done.returncode, 0, done.stderr)
        subprocess.run([bin_dir / "echofuse-acquire", "import", self.raw, "--out", self.again, "-q"], check=True, timeout=60)
        return done.stderr

    def test_import_of_a_raw_capture_gives_the_records_of_the_live_run(self):
        (self.dir / "faults.toml").write_text(FAULTS)
        # The run is paused for several slots, as on a busy machine: its slots are closed late, after their deadlines.
        paused = "sh", "-c", '"$@" & sleep 5; kill -STOP $!; sleep 1.5; kill -CONT $!; wait $!', "sh"
        antennas = "--radar-cfg", source / "config/radar/xwr68xx_azimuth_50cm.cfg", "--set", "radar_sum=coherent"
        log = self.record(20, 0.4, *paused, options=("--window", 0.4, "--scene", "mixed", "--faults", self.dir / "faults.toml",
                                                     *antennas))
        self.assertIn(f"raw: {sum(f.stat().st_size for f in self.raw.iterdir())} bytes recorded in {self.raw}, 0 not recorded", log)
        said = b"".join(f.read_bytes() for f in sorted(self.raw.glob("radar-cli-*.txt")))
        self.assertIn(b"sensorStart", said)
        self.assertIn(b"mmwDemo:/>", said)
        for device in "tags-*.blocks", "radar-[0-9]*.dat":
            self.assertGreater(len(list(self.raw.glob(device))), 1, log)
        self.assertEqual(fixtures.query(self.run, "SELECT idx FROM record"), [(k,) for k in range(20)], log)
        for query in RECORDS, COUNTERS:
            self.assertEqual(fixtures.query(self.again, query), fixtures.query(self.run, query), log)
        counted = {row[:2]: row[2] for row in fixtures.query(self.run, COUNTERS)}
        self.assertGreater(counted["spd", "bad_crcs"], 0, log)
        self.assertGreater(counted["radar", "junk_bytes"], 0)
        frames, = fixtures.query(self.run, "SELECT sum(array_frames), sum(radar_used) FROM record WHERE array IS NOT NULL")
        self.assertGreater(frames[0] or 0, 0, log)
        self.assertEqual(frames[0], frames[1])
        # An import does not start the alert program that the stored configuration names.
        kept, called = self.raw / "lab.toml", self.dir / "called"
        kept.write_text(kept.read_text().replace("on_doubt = []", f'on_doubt = ["/usr/bin/touch", "{called}"]'))
        self.assertIn(str(called), kept.read_text())
        subprocess.run([bin_dir / "echofuse-acquire", "import", self.raw, "--out", self.dir / "third", "-q"], check=True, timeout=60)
        self.assertFalse(called.exists())
        # Import must reject a damaged slot length, for example 400 s or 1 ns.
        times = (self.raw / "run.times").read_text()
        for length in "400000000000", "4000000000000000000", "-400000000", "1":
            (self.raw / "run.times").write_text(re.sub(r"( slots )\d+", rf"\g<1>{length}", times))
            done = fixtures.outcome("echofuse-acquire", "import", self.raw, "--out", self.dir / "other", timeout=20)
            self.assertEqual(done.returncode, 1, done.stderr)
            self.assertIn("check whether a number is damaged", done.stderr)

    def test_daemon_records_from_an_emulated_usb_tagger(self):
        log = self.record(10, USB_WINDOW_S, options=("--scene", "mixed", "--hold", "1", "--window", USB_WINDOW_S),
                          simulator=[bin_dir.parent / "tests/usb_lab"])
        self.assertEqual(fixtures.query(self.run, "SELECT valid, spd_lost FROM record"), [(7, 0)] * 10, log)
        self.assertEqual(fixtures.query(self.run, "SELECT serial FROM device WHERE sensor = 'spd'"), [("SIM-USB-1",)])
        for query in "SELECT spd FROM record ORDER BY idx", COUNTERS.replace(", 'radar'", ""):
            self.assertEqual(fixtures.query(self.again, query), fixtures.query(self.run, query))
        sent = json.loads((self.dir / "lab/sent.json").read_text())["tdc"]
        self.assertEqual((sent["lost"], sent["starts"]), (0, 1))
        # When the daemon stops the device, the device may still contain the tags of the last 0.2 s.
        missing = sent["tags"] - int(re.search(r"received: (\d+) tags", log)[1])
        self.assertGreaterEqual(missing, 0, log)
        self.assertLess(missing, 0.2 / (10 * USB_WINDOW_S) * sent["tags"], log)


main(Raw)
