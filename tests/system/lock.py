#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that commands report the devices in use by a run and do not disturb the run."""
import json
import re
import subprocess

import live


class Lock(live.Live):
    def acquire(self, *words):
        return subprocess.run([live.bin_dir / "echofuse-acquire", *map(str, words)], env=self.environment(), text=True,
                              capture_output=True, timeout=50)

    def config(self):
        return "--config", self.dir / "lab/lab.toml"

    def test_commands_report_that_a_device_is_in_use_by_a_run(self):
        """`run`, `calibrate`, `devices` and `doctor` report which run is using the devices, and this run loses no
        data. The commands can still use the camera, which is not part of the run."""
        daemon = self.record("--count", "30", "--set", "depth.address=")
        live.wait_for("records", lambda: self.committed() >= 3)
        holder = f"in use by echofuse-acquire run, pid {daemon.pid}, run {self.run}"

        def check(done, code, sensors=("spd", "radar")):
            self.assertEqual(done.returncode, code, done.stdout + done.stderr)
            for sensor in sensors:
                self.assertRegex(done.stdout + done.stderr, rf"{sensor} [^\n]*{re.escape(holder)}")
        check(self.acquire("run", *self.config(), "--out", self.dir / "second"), 4)
        self.assertFalse((self.dir / "second.sqlite").exists())
        check(self.acquire("calibrate", *self.config(), "--set", f"run.calibration={self.dir}/c.toml"), 4)
        # `run` reports that the ports are in use even if the configuration contains different paths to the same
        # ports.
        nodes = [(self.dir / "lab" / name).resolve() for name in ("radar-cli", "radar-data")]
        done = self.acquire("run", *self.config(), "--out", self.dir / "second", "--set", f"radar.cli=serial:{nodes[0]}",
                            "--set", f"radar.data=serial:{nodes[1]}", "--set", "tdc.address=", "--set", "depth.address=",
                            "--set", "run.connect_timeout_s=0.5")
        self.assertEqual(done.returncode, 4, done.stderr)
        self.assertIn("in use by another program", done.stderr)

        done = self.acquire("devices", *self.config(), "--json")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        *taken, free = json.loads(done.stdout)["configured"]
        self.assertEqual((free["sensor"], free["state"], free["answers"]), ("depth", "streaming", True))
        for device in taken:
            self.assertEqual((device["state"], device["answers"], device["run"]), ("in use", True, str(self.run)))
            self.assertRegex(device["last_event"], rf"{re.escape(holder)}; record \d+, [\d.]+ s ago: [^,]+, \d+ ")
        check(self.acquire("devices", *self.config()), 0)
        done = self.acquire("doctor", *self.config(), "--set", f"run.folder={self.dir}", "--duration", "10s")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        for sensor in "spd", "radar":
            self.assertRegex(done.stdout, rf"warning +{sensor} +{re.escape(holder)}; record \d+, [\d.]+ s ago: \w+")

        log = self.finish(daemon)
        self.check_slots(self.rows())
        self.assertEqual(len(self.rows()), 30)
        self.assertNotRegex(log, r"warning (spd|radar): (?!record|did not confirm)")
        info = self.info()
        self.assertEqual(info["lost"]["spd"], 0, log)
        # The devices are free after the run.
        done = self.acquire("devices", *self.config(), "--json")
        self.assertEqual([d["state"] for d in json.loads(done.stdout)["configured"]], ["streaming"] * 3)
        # No frame is lost in transport, but the simulated board may skip frames on a busy machine.
        self.assertLessEqual(info["lost"]["radar"], self.close_lab()["radar"]["frames_skipped"], log)


live.main(Lock)
