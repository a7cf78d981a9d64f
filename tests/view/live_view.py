#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests echofuse-view with a daemon that records from the simulated laboratory."""
import json
import pathlib
import re
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
import live
import fixtures
from live import WINDOW_S, bin_dir, viewers_of, wait_for
from page_socket import Browser



class LiveView(live.Live):
    def view(self, *options, of=None, listen="127.0.0.1:0"):
        """Starts a viewer of the run, or of the folder `of`. Returns its address."""
        process = self.start([bin_dir / "echofuse-view", of or self.run, *options, "--listen", listen], stdout=subprocess.PIPE,
                             stderr=subprocess.DEVNULL, text=True)
        return process.stdout.readline().strip()

    def open_again(self, *lab_options):
        (self.dir / "lab/lab.toml").unlink()
        self.lab = self.start_lab(self.dir / "lab", *self.lab_options, "--log", self.dir / "sent.jsonl", *lab_options)

    def program(self, name, *words):
        """Runs a program in the folder of the test. Returns its output."""
        return self.call(f"echofuse-{name}", *words)

    def test_viewer_follows_a_recording_that_continues_in_new_files(self):
        daemon = self.record("--every", f"{3 * WINDOW_S}s", "--count", "5", "--json", "--view", "--model",
                             self.dir / "lab/lab.toml", stdout=subprocess.PIPE)
        client = Browser(daemon.stdout.readline().strip())
        client.until("state", lambda m: m["status"] == "complete" and m["records"] == 2)
        told, log = daemon.communicate(timeout=30)
        events = [json.loads(line) for line in told.splitlines()]
        files = [str(self.run.with_name(f"{self.run.stem}-{n:03}.sqlite")) for n in (1, 2)]
        self.assertEqual([e["file"] for e in events if e["event"] == "run"], files)
        self.assertEqual(events[-1]["on_disk"], 5)
        self.assertIn(f"{files[1]}: 5 of 5 records in 2 runs, complete", log)
        self.assertIn("not a model file, or truncated; expected a safetensors file; the page shows no reconstructions", log)

    def test_viewer_follows_and_annotates_a_live_run(self):
        client = Browser(self.view())
        self.assertIn("the run does not exist yet", client.until("trouble")["text"])
        daemon = self.record("--set", "run.label=empty")
        self.assertTrue(client.until("run")["may_write"])
        first = client.until("record", lambda m: m["live"])["index"]
        client.until("record", lambda m: m["live"] and m["index"] > first)

        def here():
            runs = fixtures.json_of("echofuse-acquire", "list", self.dir)["runs"]
            return next(run for run in runs if run["path"] == str(self.run))
        wait_for("ok of the SPD", lambda: here()["live"]["sensors"].get("spd", {}).get("verdict") == "ok")
        self.assertGreater(here()["records"], 1)
        self.assertRegex(self.program("acquire", "list", self.dir), rf"{self.run} is live; its last record is \S+ s old\n")
        for request in {"label": "person"}, {"mark": "door opened"}:
            client.ask(request)
            self.assertTrue(client.until("answer")["ok"])
        client.until("record", lambda m: m["label"] == "person")
        client.until("state", lambda m: any(e["level"] == "note" and e["text"] == "door opened" for e in m["events"]))
        client.until("state", lambda m: m["sensors"]["radar"]["valid"])
        self.close_lab()
        closed = time.monotonic()
        # On a busy machine, records arrive late, so a sensor's data may become stale before its verdict arrives.
        client.until("state", lambda m: all(m["sensors"][s]["stale"] for s in ("spd", "radar", "depth")))
        # The limit includes two slots, the grace time of 0.5 s, and up to one second until the next state message.
        self.assertLess(time.monotonic() - closed, 2 * WINDOW_S + 3)
        client.until("state", lambda m: m["sensors"]["radar"]["verdict"] == "no frames")
        daemon.kill()
        daemon.wait()
        self.assertEqual(client.until("state", lambda m: m["status"] != "open")["status"], "crashed")
        client.close()

    def test_alignment_mode_deletes_its_run_at_the_end(self):
        daemon = self.start([bin_dir / "echofuse-acquire", "run", "--align", "--config", self.dir / "lab/lab.toml"],
                            env=self.environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        address = daemon.stdout.readline().strip()
        client = Browser(address)
        self.assertEqual(client.until("run")["window_s"], 0.1)
        for _ in range(5):
            client.until("record")
        log = self.finish(daemon, signal.SIGINT)
        folder = pathlib.Path(re.search(r"recording to (\S+)/align.sqlite", log)[1])
        self.assertFalse(folder.exists())
        self.assertEqual(len(viewers_of(f"{folder}/")), 1)
        client.close()
        wait_for("end of the viewer", lambda: not viewers_of(f"{folder}/"), 15)

if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"LiveView.{name}" for name in sys.argv[2:])])
