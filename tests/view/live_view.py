#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/view/live_view.py BIN_DIR [TEST]: echofuse-view beside a daemon that records from the simulated laboratory."""
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
from live import WINDOW_S, bin_dir, wait_for
from websocket import Client

SCRIPTS = pathlib.Path(__file__).resolve().parent.parent.parent / "scripts"


class LiveView(live.Live):
    @property
    def lab_options(self):
        return (*live.Live.lab_options, "--log", self.dir / "sent.jsonl")

    def view(self, *options):
        process = self.start([bin_dir / "echofuse-view", self.run, *options], stdout=subprocess.PIPE,
                             stderr=subprocess.DEVNULL, text=True)
        return process.stdout.readline().strip()

    def status(self):
        return json.loads(subprocess.run([bin_dir / "echofuse-acquire", "status", "--json"], check=True,
                                         stdout=subprocess.PIPE).stdout)

    def test_life(self):
        """Waits for the run, moves with it, marks it, shows lost devices, the daemon's end and a resumed run."""
        client = Client(self.view())
        self.assertIn("no run yet", client.until("trouble")["text"])
        daemon = self.record("--label", "empty")
        self.assertTrue(client.until("run")["may_write"])
        first = client.until("record")["index"]
        self.assertGreater(client.until("record", lambda m: m["live"])["index"], first)
        here = [run for run in self.status() if run["run"] == str(self.run)]
        self.assertEqual(len(here), 1)
        self.assertGreater(here[0]["records"], 1)
        self.assertEqual(here[0]["sensors"]["spd"]["verdict"].split(":")[0] in ("ok", "weak", "saturated"), True, here)
        self.assertIn(f"pid {daemon.pid}", here[0]["who"])
        text = subprocess.run([bin_dir / "echofuse-acquire", "status"], check=True, stdout=subprocess.PIPE, text=True)
        self.assertIn(f"{self.run}: ", text.stdout)
        client.ask({"label": "person"})
        client.ask({"mark": "door opened"})
        self.assertTrue(client.until("answer")["ok"])
        self.assertTrue(client.until("answer")["ok"])
        client.until("record", lambda m: m["label"] == "person")
        client.until("state", lambda m: any(e["level"] == "mark" and e["text"] == "door opened" for e in m["events"]))
        client.until("state", lambda m: m["sensors"]["radar"]["valid"])
        self.close_lab()
        closed = time.monotonic()
        state = client.until("state", lambda m: all(m["sensors"][s]["stale"] for s in ("spd", "radar", "depth")))
        # Two slots, the acquisition's grace of half a second, and a second until the next state.
        self.assertLess(time.monotonic() - closed, 2 * WINDOW_S + 3)
        self.assertEqual(state["sensors"]["radar"]["verdict"], "no frames")
        daemon.kill()
        daemon.wait()
        self.assertEqual(client.until("state", lambda m: m["status"] != "open")["status"], "crashed")
        records = client.until("state")["records"]
        self.lab = self.start([bin_dir / "echofuse-sim", "lab", "--dir", self.dir / "lab", "--scene", "mixed", "--window",
                               str(WINDOW_S), *self.lab_options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(1)
        wait_for("lab.toml", (self.dir / "lab/lab.toml").exists)
        again = self.start([bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--resume", self.run],
                           env=os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")}, stderr=subprocess.PIPE,
                           text=True)
        client.until("state", lambda m: m["status"] == "open" and m["records"] > records)
        again.send_signal(signal.SIGINT)
        self.finish(again)
        self.assertEqual(client.until("state", lambda m: m["status"] != "open")["status"], "complete")

    def test_run_view(self):
        """`run --view` prints an address; the viewer ends by itself when the run is over and nobody looks."""
        daemon = self.record("--count", "8", "--view", stdout=subprocess.PIPE)
        address = daemon.stdout.readline().strip()
        self.assertRegex(address, r"^http://127.0.0.1:\d+/\?token=\w+$")
        client = Client(address)
        state = client.until("state")
        self.assertEqual(state["planned"], 8)
        client.until("state", lambda m: m["status"] == "complete")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        client.socket.close()
        wait_for("end of the viewer", lambda: not self.listens(address), 15)

    def test_align(self):
        """Slots of 0.1 s in a run that is gone at the end, and its view."""
        daemon = self.start([bin_dir / "echofuse-acquire", "align", "--config", self.dir / "lab/lab.toml"],
                            env=os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")}, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True)
        address = daemon.stdout.readline().strip()
        client = Client(address)
        self.assertEqual(client.until("run")["window_s"], 0.1)
        for _ in range(5):
            client.until("record")
        daemon.send_signal(signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        folder = pathlib.Path(re.search(r"recording into (\S+)/align.sqlite", log)[1])
        self.assertFalse(folder.exists())
        client.socket.close()
        wait_for("end of the viewer", lambda: not self.listens(address), 15)

    def test_fifty(self):
        """50 viewers, and one that never reads: the same slots and no loss that the laboratory cannot explain."""
        daemon = self.record("--count", "40")
        address = self.view()
        silent = Client(address)
        frames = [0] * 50
        clients = [Client(address) for _ in frames]

        def look(k):
            try:
                while True:
                    frames[k] += clients[k].message()["kind"] == "record"
            except (OSError, EOFError):
                pass
        threads = [threading.Thread(target=look, args=(k,), daemon=True) for k in range(50)]
        for thread in threads:
            thread.start()
        log = self.finish(daemon, 60)
        self.assertEqual(daemon.returncode, 0, log)
        time.sleep(1)
        viewer = self.processes[-1]
        with open(f"/proc/{viewer.pid}/stat", encoding="ascii") as stat:
            ticks = sum(map(int, stat.read().rsplit(")", 1)[1].split()[11:13]))
        cpu_s = ticks / os.sysconf("SC_CLK_TCK")
        print(f"viewer {cpu_s:.1f} s of a core in {40 * WINDOW_S:.0f} s, records a client {min(frames)} to {max(frames)}",
              file=sys.stderr)
        for client in clients:
            client.socket.close()
        silent.socket.close()
        self.close_lab()
        self.assertEqual(len(self.rows()), 40)
        self.check_slots(self.rows())
        self.assertGreater(min(frames), 10)
        audit = subprocess.run([sys.executable, SCRIPTS / "audit_run.py", self.run, self.dir / "sent.jsonl"],
                               stdout=subprocess.PIPE, text=True)
        self.assertEqual(audit.returncode, 0, audit.stdout)

    def listens(self, address):
        try:
            Client(address).socket.close()
        except ConnectionRefusedError:
            return False
        return True


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"LiveView.{name}" for name in sys.argv[2:])])
