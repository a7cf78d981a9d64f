#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/lock.py BIN_DIR TEST: what other programs find while a run has the devices, and that the run does not
notice them."""
import fcntl
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import termios
import time
import unittest

import live


class Lock(live.Live):
    def acquire(self, *words):
        env = os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")}
        return subprocess.run([live.bin_dir / "echofuse-acquire", *map(str, words)], env=env, text=True,
                              capture_output=True, timeout=50)

    def config(self):
        return "--config", self.dir / "lab/lab.toml"

    def events(self):
        db = sqlite3.connect(self.run)
        try:
            return db.execute("SELECT level, source, text FROM event").fetchall()
        finally:
            db.close()

    def test_beside_a_run(self):
        """`run`, `calibrate`, `devices` and `doctor` during a run: told who has the devices; the run loses nothing."""
        daemon = self.record("--count", "40")
        live.wait_for("records", lambda: self.committed() >= 3)
        holder = f"in use by echofuse-acquire run, pid {daemon.pid}, run {self.run}"

        def check(done, code, sensors=("spd", "radar", "depth")):
            self.assertEqual(done.returncode, code, done.stdout + done.stderr)
            for sensor in sensors:
                self.assertRegex(done.stdout + done.stderr, rf"{sensor} [^\n]*{re.escape(holder)}")
        check(self.acquire("run", *self.config(), "--out", self.dir / "second"), 4)
        self.assertFalse((self.dir / "second.sqlite").exists())
        check(self.acquire("calibrate", *self.config(), "--set", f"run.calibration={self.dir}/c.toml"), 4)
        # The ports by other names are the same ports, which are opened exclusively.
        nodes = [(self.dir / "lab" / name).resolve() for name in ("radar-cli", "radar-data")]
        done = self.acquire("run", *self.config(), "--out", self.dir / "second", "--set", f"radar.cli=serial:{nodes[0]}",
                            "--set", f"radar.data=serial:{nodes[1]}", "--set", "tdc.address=", "--set", "depth.address=",
                            "--set", "run.connect_timeout_s=0.5")
        self.assertEqual(done.returncode, 4, done.stderr)
        self.assertIn("in use by another program", done.stderr)

        done = self.acquire("devices", *self.config(), "--json")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        for device in json.loads(done.stdout)["configured"]:
            self.assertEqual((device["state"], device["answers"], device["run"]), ("in use", True, str(self.run)))
            self.assertRegex(device["last_event"], rf"{re.escape(holder)}; record \d+, [\d.]+ s ago: ok, \d+ ")
        check(self.acquire("devices", *self.config()), 0)
        done = self.acquire("doctor", *self.config(), "--set", f"run.folder={self.dir}", "--duration", "10s")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        for sensor in "spd", "radar", "depth":
            self.assertRegex(done.stdout, rf"warning +{sensor} +{re.escape(holder)}; record \d+, [\d.]+ s ago: ok")

        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        self.check_slots(self.rows())
        self.assertEqual(len(self.rows()), 40)
        self.assertNotRegex(log, r"warning (spd|radar|depth): (?!record|did not confirm)")
        info = self.info()
        self.assertEqual(info["lost"]["spd"], 0, log)
        # And now they are free.
        done = self.acquire("devices", *self.config(), "--json")
        self.assertEqual([d["state"] for d in json.loads(done.stdout)["configured"]], ["streaming"] * 3)
        # No frame was lost on the line: only those that the board itself had no time for on a busy machine.
        self.assertLessEqual(info["lost"]["radar"], self.close_lab()["radar"]["frames_skipped"], log)

    def test_part(self):
        """Of three devices one is another run's: `devices` asks the two others, `run` leaves all three alone."""
        daemon = self.record("--set", "tdc.address=", "--set", "depth.address=")
        live.wait_for("records", lambda: self.committed() >= 2)
        done = self.acquire("devices", *self.config(), "--json")
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertEqual([(d["sensor"], d["state"]) for d in json.loads(done.stdout)["configured"]],
                         [("spd", "streaming"), ("radar", "in use"), ("depth", "streaming")])
        done = self.acquire("run", *self.config(), "--out", self.dir / "second", "--count", "1")
        self.assertEqual(done.returncode, 4, done.stderr)
        self.assertEqual(done.stderr.count("in use by"), 1, done.stderr)
        daemon.send_signal(signal.SIGINT)
        self.assertEqual(daemon.wait(20), 0)

    def test_killed(self):
        """A lock dies with its process: the run goes on at once."""
        daemon = self.record()
        live.wait_for("records", lambda: self.committed() >= 2)
        daemon.kill()
        daemon.wait()
        log, code = self.resume("--count", "2")
        self.assertEqual(code, 0, log)
        self.assertEqual(self.rows()[-1]["valid"], 7, log)

    def test_another_program(self):
        """A terminal program that locks the port as it should is not disturbed, and blamed."""
        with open(self.dir / "lab/radar-cli", "rb+", buffering=0) as port:
            fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.set_blocking(port.fileno(), False)
            time.sleep(0.3)
            port.read()  # the board's greeting
            before = termios.tcgetattr(port)
            done = self.acquire("devices", *self.config(), "--set", "run.connect_timeout_s=1")
            self.assertEqual(done.returncode, 4, done.stdout)
            self.assertIn("radar-cli: open (in use by another program): Device or resource busy", done.stdout)
            self.assertEqual(termios.tcgetattr(port), before)
            self.assertFalse(port.read(), "something was sent to the radar, and it answered")

    def test_radar_hangs(self):
        """A radar that does not answer `sensorStop` costs 0.3 s, and is warned of."""
        daemon = self.record("--set", "depth.address=", "--set", "tdc.address=")
        live.wait_for("records", lambda: self.committed() >= 2)
        self.lab.send_signal(signal.SIGSTOP)
        daemon.send_signal(signal.SIGTERM)
        asked = time.monotonic()
        log = self.finish(daemon)
        self.assertLess(time.monotonic() - asked, 5, log)
        self.lab.send_signal(signal.SIGCONT)
        self.assertEqual(daemon.returncode, 0, log)
        self.assertIn("warning radar: did not confirm that it stopped", log)
        self.assertIn("did not confirm", str(self.events()))

    def test_radar_after_run(self):
        daemon = self.record("--count", "2")
        self.finish(daemon)
        self.assertEqual(self.close_lab()["radar"]["radiates"], 0)

    def test_radar_keeps_running(self):
        daemon = self.record("--count", "2", "--set", "radar.keep_running=true")
        self.finish(daemon)
        self.assertEqual(self.close_lab()["radar"]["radiates"], 1)

    def test_radar_stopped_before_the_first_slot(self):
        """A run that does not begin, as another device is required, leaves no radar radiating."""
        daemon = self.record("--set", "tdc.address=usb:ffff:ffff", "--set", "tdc.policy=required", "--set",
                             "run.connect_timeout_s=2")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 4, log)
        self.assertIn("radar: connected to", log)
        if "did not confirm" in log:
            time.sleep(2)  # on a busy machine the laboratory reads the command later
        self.assertEqual(self.close_lab()["radar"]["radiates"], 0)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"Lock.{name}" for name in sys.argv[2:])])
