#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""clock_is_set.py BIN_DIR [TEST]: the machine's UTC is set during a run of the real daemon."""
import datetime
import os
import signal
import sqlite3
import subprocess
import sys
import time
import unittest

import live
from live import bin_dir, wait_for


class ClockIsSet(live.Live):
    def test_steps_of_a_day(self):
        """UTC goes a day forward, and two back: events, anchors, and records with the time of their slots."""
        offset = self.dir / "offset"

        def set_clock(seconds):
            (self.dir / "new").write_text(str(seconds))
            (self.dir / "new").rename(offset)

        set_clock(0)
        env = os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni"), "CLOCK_FILE": str(offset),
                            "LD_PRELOAD": str(bin_dir.parent / "tests/libset_clock.so"),
                            "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"}
        command = [bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--out", self.run]
        day = 86400
        daemon = self.start(command, env=env, stderr=subprocess.PIPE, text=True)
        for seconds in (day, -day):
            before = self.committed()
            wait_for("records", lambda: self.committed() >= before + 3)
            set_clock(seconds)
        before = self.committed()
        wait_for("records", lambda: self.committed() >= before + 5)
        daemon.send_signal(signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        rows = self.rows()
        self.check_slots(rows)
        db = sqlite3.connect(self.run)
        events = db.execute("SELECT level, text FROM event WHERE source = 'clock' ORDER BY id").fetchall()
        anchors = db.execute("SELECT mono_ns, utc_ns FROM anchor ORDER BY mono_ns").fetchall()
        db.close()
        self.assertEqual([level for level, _ in events], ["warning"] * 2, log)
        for _, text in events:
            self.assertIn("the machine's clock was set, or the machine slept: from 2", text)
        self.assertEqual([round((b[1] - b[0] - a[1] + a[0]) / 1e9) for a, b in zip(anchors, anchors[1:])],
                         [day, -2 * day], anchors)
        for row in rows:
            mono, utc = max(anchor for anchor in anchors if anchor[0] <= max(row["slot_start_ns"], anchors[0][0]))
            self.assertLess(abs(row["slot_utc_ns"] - row["slot_start_ns"] - utc + mono), 1e6, row["idx"])
        info = self.info()
        last = datetime.datetime.fromisoformat(info["last_slot_end_utc"].replace("Z", "+00:00")).timestamp()
        self.assertLess(abs(last + day - time.time()), 60)

        set_clock(330 * 365 * day)  # nanoseconds since 1970 do not fit into 64 bits
        late = subprocess.run([*command[:-1], self.dir / "late", "--count", "1"], env=env, capture_output=True, text=True)
        self.assertEqual(late.returncode, 1, late.stderr)
        self.assertIn("the machine's clock is at 2260-", late.stderr)
        self.assertFalse((self.dir / "late.sqlite").exists())


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"ClockIsSet.{name}" for name in sys.argv[2:])])
