#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that a run reports its end on every way out."""
import json
import os
import resource
import signal
import subprocess
import time

import live
import fixtures
from live import viewers_of, wait_for


class Ends(live.Live):
    def begin(self, *options, alert="", **how):
        """Starts a run with a page, --json and an alert program, which runs the command `alert` last."""
        self.calls, config = self.dir / "calls", self.dir / "lab/lab.toml"
        program = self.dir / "lab/alert"
        program.write_text(f'#!/bin/sh\necho "$ECHOFUSE_SOURCE $ECHOFUSE_DOUBT $ECHOFUSE_TEXT" >>{self.calls}\necho to stdout\n{alert}\n')
        program.chmod(0o755)
        if "[alert]" not in config.read_text():
            config.write_text(config.read_text() + '\n[alert]\non_doubt = ["./alert"]\n')
        return self.record("--view", "--json", *options, stdout=subprocess.PIPE, **how)

    def ended(self, daemon, code, text, records):
        """Checks the exit code, the end in --json, the alert program's last call, and that the page is still served."""
        told, log = daemon.communicate(timeout=30)
        self.assertEqual(daemon.returncode, code, log)
        end = json.loads(told.splitlines()[-1])
        self.assertNotIn("to stdout", told)
        self.assertEqual((end["event"], end["code"], end["on_disk"]), ("end", code, records))
        first, *_, last = [call for call in self.calls.read_text().splitlines() if call.startswith("run ")]
        self.assertEqual(first, "run started recording")
        self.assertRegex(last, f"^run ended .*{text}")
        viewer, = viewers_of(self.run)
        os.kill(viewer, signal.SIGTERM)
        wait_for("the end of the viewer", lambda: not viewers_of(self.run))

    def test_complete_run_reports_its_end(self):
        daemon = self.begin("--count", "3", "--set", "signal.spd_clicks=1e9")
        self.ended(daemon, 0, "complete", 3)
        doubts = [call for call in self.calls.read_text().splitlines() if call.startswith("spd ")]
        self.assertRegex(" ".join(doubts), r"^spd weak weak: \d+ clicks [^:]*$")

    def test_alert_program_killed_at_the_end_is_an_event(self):
        daemon = self.begin("--count", "3", alert='[ "$ECHOFUSE_DOUBT" != started ] || exec sleep 60')
        self.ended(daemon, 0, "complete", 3)
        texts = [text for text, in fixtures.query(self.run, "SELECT text FROM event")]
        self.assertTrue(any("was killed because the run ended" in text for text in texts), texts)

    def test_run_on_a_full_disk_reports_its_end(self):
        daemon = self.begin("--set", "depth.address=", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (256 << 10, 256 << 10)))
        daemon.wait(60)
        self.ended(daemon, 6, "records were not written", len(self.rows()))

    def test_interrupted_run_reports_its_end(self):
        """A slot that would last longer than the time limit is discarded."""
        daemon = self.begin("--set", "run.window_s=60")
        wait_for("the run", self.run.exists)
        time.sleep(1)  # Slot 0 begins 0.1 s after the file was made.
        self.assertEqual(self.info()["status"], "open")
        sent = time.monotonic()
        daemon.send_signal(signal.SIGTERM)
        self.ended(daemon, 0, "stopped:interrupted", 0)
        self.assertLess(time.monotonic() - sent, 5)
        self.assertEqual((self.info()["status"], self.info()["records"]), ("stopped:interrupted", 0))

    def test_interrupt_before_the_first_slot_leaves_no_file(self):
        """With slots of 9 s, slot 0 begins up to 9 s after the file appears."""
        daemon = self.begin("--set", "run.window_s=9")
        wait_for("the run", self.run.exists)
        daemon.send_signal(signal.SIGINT)
        told, log = daemon.communicate(timeout=30)
        if "slot abandoned" in log or "finishing the slot" in log:
            return live.not_checked("interrupt before slot 0", "slot 0 began before the signal")
        self.assertEqual((daemon.returncode, json.loads(told.splitlines()[-1])["code"]), (130, 130), log)
        self.assertIn("nothing was recorded", log)
        self.assertEqual((list(self.dir.glob("run.sqlite*")), viewers_of(self.run)), ([], []))


live.main(Ends)
