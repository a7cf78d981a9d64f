#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests echofuse-view with a daemon that records from the simulated laboratory."""
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
import live
from case import call
from live import WINDOW_S, bin_dir, viewers_of, wait_for
from page_socket import Browser, Client

RECORDS = 40
SCRIPTS = pathlib.Path(__file__).resolve().parent.parent.parent / "scripts"


def processor_s(process):
    with open(f"/proc/{process.pid}/stat", encoding="ascii") as stat:
        ticks = sum(map(int, stat.read().rsplit(")", 1)[1].split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


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
        return call(self.dir, f"echofuse-{name}", *words)

    def test_viewer_follows_a_recording_that_continues_in_new_files(self):
        """`run --every` reports each new file, and the viewer follows the newest file. If the model file is invalid,
        the viewer shows no depth maps."""
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
        """The viewer waits for a run, follows it and adds marks. It also shows that devices are lost and that the
        daemon has ended."""
        client = Browser(self.view())
        self.assertIn("the run does not exist yet", client.until("trouble")["text"])
        daemon = self.record("--set", "run.label=empty")
        self.assertTrue(client.until("run")["may_write"])
        first = client.until("record", lambda m: m["live"])["index"]
        client.until("record", lambda m: m["live"] and m["index"] > first)

        def here():
            return [run for run in json.loads(self.program("acquire", "list", "--json", self.dir))["runs"] if run["path"] == str(self.run)]
        self.assertEqual(len(here()), 1)
        wait_for("ok of the SPD", lambda: here()[0]["live"]["sensors"].get("spd", {}).get("verdict") == "ok")
        self.assertGreater(here()[0]["records"], 1)
        self.assertRegex(self.program("acquire", "list", self.dir), rf"{self.run} is live; its last record is \S+ s old\n")
        client.ask({"label": "person"})
        client.ask({"mark": "door opened"})
        self.assertTrue(client.until("answer")["ok"])
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
        """In alignment mode, the slots last 0.1 s, and the run is deleted at the end. The viewer of the run exits
        when no browser is connected."""
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

    def test_fifty_viewers_do_not_disturb_a_live_run(self):
        """A run with 50 viewers and a client that never reads must have the same slots and losses as a run without
        viewers."""
        log = self.finish(self.record("--count", str(RECORDS)), timeout_s=60)
        alone = self.account(log)
        self.open_again()
        self.run = self.dir / "watched.sqlite"
        daemon = self.record("--count", str(RECORDS))
        address = self.view()
        viewer = self.processes[-1]
        silent = Client(address)
        frames = [0] * 50
        clients = [Client(address) for _ in frames]

        def look(k):
            try:
                while True:
                    frames[k] += clients[k].message()["kind"] == "record"
            except (OSError, EOFError):
                pass
        for k in range(50):
            threading.Thread(target=look, args=(k,), daemon=True).start()
        log = self.finish(daemon, timeout_s=60)
        time.sleep(1)
        print(f"without viewers {alone}, viewer {processor_s(viewer):.1f} s of a core in {RECORDS * WINDOW_S:.0f} s, records per client {min(frames)} to "
              f"{max(frames)}", file=sys.stderr)
        for client in clients:
            client.socket.close()
        silent.socket.close()
        self.assertGreater(min(frames), 10)
        self.assertEqual(self.account(log), alone)

    def account(self, log):
        """Checks that every difference between the run and the laboratory's log is explained. Returns the verdicts
        and the counts of valid, lost and late data, for comparison with another run."""
        self.close_lab()
        self.check_slots(self.rows())
        audit = subprocess.run([sys.executable, SCRIPTS / "audit_run.py", self.run, self.dir / "sent.jsonl"],
                               stdout=subprocess.PIPE, text=True)
        self.assertEqual(audit.returncode, 0, audit.stdout + log)
        info = self.info()
        self.assertEqual(info["records"], RECORDS, log)
        late = {sensor: info["counters"][sensor]["late"] for sensor in ("spd", "radar", "depth")}
        return {what: info[what] for what in ("valid", "lost", "verdicts")} | {"late": late}


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"LiveView.{name}" for name in sys.argv[2:])])
