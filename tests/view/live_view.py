#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests echofuse-view with a daemon that records from the simulated laboratory. Called as `tests/view/live_view.py
BIN_DIR [TEST]`."""
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
from page_socket import Browser, Client

RECORDS = 40
SCRIPTS = pathlib.Path(__file__).resolve().parent.parent.parent / "scripts"


def processor_s(process):
    with open(f"/proc/{process.pid}/stat", encoding="ascii") as stat:
        ticks = sum(map(int, stat.read().rsplit(")", 1)[1].split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def viewers_of(folder):
    """Returns the process IDs of the viewers that show runs in this folder. Ports do not identify the viewers,
    because another test may reuse a port."""
    out = []
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_text(encoding="utf-8", errors="replace").split("\0")
        except OSError:
            continue  # the process has already exited
        if pathlib.Path(words[0]).name == "echofuse-view" and words[1].startswith(f"{folder}/"):
            out.append(int(process.name))
    return out


class LiveView(live.Live):
    @property
    def lab_options(self):
        return (*live.Live.lab_options, "--log", self.dir / "sent.jsonl")

    def view(self, *options):
        if "--listen" not in options:
            options += ("--listen", "127.0.0.1:0")
        process = self.start([bin_dir / "echofuse-view", self.run, *options], stdout=subprocess.PIPE,
                             stderr=subprocess.DEVNULL, text=True)
        return process.stdout.readline().strip()

    def open_again(self, *lab_options):
        (self.dir / "lab/lab.toml").unlink()
        self.lab = self.start([bin_dir / "echofuse-sim", "lab", "--dir", self.dir / "lab", "--scene", "mixed", "--window",
                               WINDOW_S, *self.lab_options, *lab_options], stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL)
        wait_for("lab.toml", (self.dir / "lab/lab.toml").exists)

    def program(self, name, *words):
        """Runs a program in the folder of the test. Returns its output."""
        return subprocess.run([bin_dir / f"echofuse-{name}", *map(str, words)], check=True, stdout=subprocess.PIPE,
                              stderr=subprocess.DEVNULL, text=True, cwd=self.dir).stdout

    def status(self):
        return json.loads(self.program("acquire", "list", "--json", self.dir))["runs"]

    def serve(self):
        """Starts a viewer of the runs in the folder. Returns its address."""
        process = self.start([bin_dir / "echofuse-view", self.dir, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True)
        return process.stdout.readline().strip()

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
            return [run for run in self.status() if run["path"] == str(self.run)]
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
        daemon.send_signal(signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        folder = pathlib.Path(re.search(r"recording to (\S+)/align.sqlite", log)[1])
        self.assertFalse(folder.exists())
        self.assertEqual(len(viewers_of(folder)), 1)
        client.close()
        wait_for("end of the viewer", lambda: not viewers_of(folder), 15)

    def test_fifty_viewers_do_not_disturb_a_live_run(self):
        """A run with 50 viewers and a client that never reads must have the same slots and losses as a run without
        viewers."""
        log = self.finish(self.record("--count", str(RECORDS)), 60)
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
        log = self.finish(daemon, 60)
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
