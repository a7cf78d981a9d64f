#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that the daemon records through libusb from a simulated laboratory with an emulated USB time tagger. Called
as `tests/system/usb.py BIN_DIR`."""
import json
import os
import sqlite3
import subprocess

from case import Case, bin_dir, main

usb_lab = bin_dir.parent / "tests/usb_lab"
environment = os.environ | {"PATH": f"{bin_dir}:{os.environ['PATH']}"}
# The number of photons per slot is constant, so longer slots reduce the number of tags per second.
WINDOW_S = float(os.environ.get("ECHOFUSE_TEST_WINDOW_S", "0.5"))

# Totals of received data are excluded, because a live run continues to count data until its file is closed.
COUNTERS = ("SELECT name, value FROM counter WHERE source = 'spd' AND name NOT IN "
            "('bytes', 'blocks', 'tags', 'outside')")


class Usb(Case):
    def test_daemon_records_from_an_emulated_usb_tagger(self):
        lab, run = self.dir / "lab", self.dir / "run.sqlite"
        raw = self.dir / "raw"
        done = subprocess.run(
            [usb_lab, "--dir", lab, "--scene", "mixed", "--hold", "1", "--window",
             str(WINDOW_S), "--", "echofuse-acquire", "run", "--config", lab / "lab.toml", "--out", run, "--count",
             "10", "--keep-raw", raw], stderr=subprocess.PIPE, text=True, timeout=60, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        sent = json.loads((lab / "sent.json").read_text())["tdc"]
        again = run.with_name("again.sqlite")
        subprocess.run([bin_dir / "echofuse-acquire", "import", raw, "--out", again], check=True)
        db = sqlite3.connect(again)
        imported = [dict(db.execute(COUNTERS)),
                    db.execute("SELECT spd FROM record ORDER BY idx").fetchall()]
        db.close()
        db = sqlite3.connect(run)
        counted = [dict(db.execute(COUNTERS)),
                   db.execute("SELECT spd FROM record ORDER BY idx").fetchall()]
        rows = db.execute("SELECT valid, spd_lost FROM record ORDER BY idx").fetchall()
        devices = dict(db.execute("SELECT sensor, serial FROM device").fetchall())
        db.close()
        self.assertEqual(rows, [(7, 0)] * 10, done.stderr)
        self.assertEqual(devices["spd"], "SIM-USB-1")
        # Importing the raw capture must give the same counters and histograms as the live run.
        self.assertEqual(imported, counted)
        self.assertEqual((sent["lost"], sent["starts"]), (0, 1))
        # When the daemon stops the device, the device may still contain the tags of the last 0.2 s.
        arrived = int(done.stderr.split("received: ")[1].split(" tags")[0])
        self.assertLessEqual(arrived, sent["tags"])
        self.assertLess(sent["tags"] - arrived, 0.2 / (10 * WINDOW_S) * sent["tags"], done.stderr)


if __name__ == "__main__":
    main(Usb)
