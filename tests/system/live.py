#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/live.py BIN_DIR [TEST]: the real daemon records from the real simulated laboratory,
through TCP, two ptys and the stock OpenNI2 library."""
import datetime
import json
import os
import pathlib
import resource
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
from waiting import wait_for

bin_dir = pathlib.Path(sys.argv[1]).resolve()
WINDOW_S = float(os.environ.get("ECHOFUSE_TEST_WINDOW_S", "0.2"))  # longer where sanitizers slow everything down


class Live(unittest.TestCase):
    # A scene for two slots, and few clicks a pulse in the short ones.
    lab_options = ("--hold", str(2 * WINDOW_S), "--laser-rate-hz", "2e7", "--set", "signal_photons=5e4")

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="echofuse-")
        self.dir = pathlib.Path(self.folder.name)
        self.run = self.dir / "run.sqlite"
        self.processes = []
        with open(self.dir / "lab.log", "w") as log:
            self.lab = self.start([bin_dir / "echofuse-sim", "lab", "--dir", self.dir / "lab", "--scene", "mixed",
                                   "--window", str(WINDOW_S), *self.lab_options], stdout=log, stderr=log)
        wait_for("lab.toml", lambda: (self.dir / "lab/lab.toml").exists() or self.lab.poll() is not None)
        self.assertIsNone(self.lab.poll(), (self.dir / "lab.log").read_text())

    def tearDown(self):
        # The daemon before its laboratory, whose ptys another test may get at once: their locks must be free then.
        for process in reversed(self.processes):
            if process.poll() is None:
                process.kill()
            process.communicate()
        self.folder.cleanup()

    def start(self, command, **streams):
        process = subprocess.Popen(list(map(str, command)), **streams)
        self.processes.append(process)
        return process

    def record(self, *options, **how):
        env = os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")}
        return self.start([bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--out",
                           self.run.with_suffix(""), *options], env=env, stderr=subprocess.PIPE, text=True, **how)

    def finish(self, daemon, timeout_s=30):
        return daemon.communicate(timeout=timeout_s)[1]

    def close_lab(self):
        self.lab.send_signal(signal.SIGINT)
        self.assertEqual(self.lab.wait(10), 0)
        return json.loads((self.dir / "lab/sent.json").read_text())

    def info(self):
        return json.loads(subprocess.run([bin_dir / "echofuse-acquire", "info", "--json", self.run], check=True,
                                         stdout=subprocess.PIPE).stdout)

    def rows(self):
        db = sqlite3.connect(f"file:{self.run}?mode=ro", uri=True)
        db.row_factory = sqlite3.Row
        try:
            return db.execute("SELECT * FROM record ORDER BY idx").fetchall()
        finally:
            db.close()

    def committed(self):
        try:
            return len(self.rows())
        except sqlite3.Error:
            daemon = self.processes[-1]
            if daemon.poll():
                raise AssertionError(f"exit {daemon.returncode}: {daemon.stderr.read() if daemon.stderr else ''}")
            return 0

    def check_slots(self, rows):
        """No row missing, none shifted, no drift, every tag in exactly one place."""
        window_ns = round(WINDOW_S * 1e9)
        for k, row in enumerate(rows):
            self.assertEqual(row["idx"], k)
            self.assertEqual(row["slot_start_ns"], rows[0]["slot_start_ns"] + k * window_ns)
            self.assertEqual(row["slot_end_ns"], row["slot_start_ns"] + window_ns)
            self.assertEqual(row["tags"], sum(row[c] for c in ("starts", "in_range", "out_of_range", "without_start",
                                                               "other")))
            if row["valid"] & 1:
                counts = struct.unpack(f"<{len(row['spd']) // 4}I", row["spd"])
                self.assertEqual(sum(counts), row["in_range"])

    def test_count(self):
        daemon = self.record("--count", "10", "--set", "run.label=person", "--set", "depth.map_size=96")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        sent = self.close_lab()
        rows = self.rows()
        info = self.info()
        self.check_slots(rows)
        self.assertEqual(info["records"], 10)
        self.assertEqual(info["status"], "complete")
        self.assertEqual(info["labels"], {"person": 10})
        self.assertEqual(info["valid"], {"spd": 10, "radar": 10, "depth": 10}, log)
        self.assertEqual(info["lost"], {"spd": 0, "radar": 0, "depth": 0}, log)
        self.assertEqual(info["events"], {}, log)
        counts = {axis["name"]: axis["count"] for axis in info["axes"]}
        self.assertEqual((counts["depth_x"], counts["map_x"], counts["map_y"]), (320, 96, 96))
        self.assertEqual(sent["tdc"]["dropped"], 0)
        # The tagger also sends while the radar is configured and in the last grace period.
        self.assertGreater(info["tags"], 0)
        self.assertLessEqual(info["tags"], sent["tdc"]["tags"])
        self.assertEqual(len({row["radar"] for row in rows}), 10)
        self.assertLessEqual(sum(row["radar_used"] for row in rows), sent["radar"]["frames"])
        self.assertIn("record 10/10  SRD", log)
        # One time base feeds all three devices, and what each is late by is less than 10 ms.
        offsets = [info["clocks"][s]["offset_s"] for s in info["clocks"]]
        self.assertIn("spd", info["clocks"])
        self.assertLess(max(offsets) - min(offsets), 0.01, info["clocks"])

    def test_interrupt(self):
        daemon = self.record()
        wait_for("records", lambda: self.committed() >= 3)
        daemon.send_signal(signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        self.assertEqual(self.info()["status"], "complete")
        self.check_slots(self.rows())
        self.assertFalse(pathlib.Path(f"{self.run}-wal").exists())

    def test_kill(self):
        daemon = self.record()
        wait_for("records", lambda: self.committed() >= 5)
        self.assertEqual(self.info()["status"], "open")
        daemon.kill()
        daemon.wait()
        rows = self.rows()
        self.check_slots(rows)
        info = self.info()
        self.assertEqual((info["status"], info["records"]), ("crashed", len(rows)))
        self.assertGreaterEqual(len(rows), 5)
        self.assertFalse(pathlib.Path(f"{self.run}-wal").exists())  # `info` has folded it back
        self.assertEqual([tuple(r) for r in self.rows()], [tuple(r) for r in rows])

    def test_stop_and_continue(self):
        """The daemon stands still for many slots: all their rows are there. Those whose tags waited to be read, whole,
        are valid; the others say why they are not."""
        daemon = self.record()
        wait_for("records", lambda: self.committed() >= 8)  # by then the clocks are known
        daemon.send_signal(signal.SIGSTOP)
        stopped = time.monotonic_ns()
        time.sleep(20 * WINDOW_S)
        daemon.send_signal(signal.SIGCONT)
        went_on = time.monotonic_ns()
        wait_for("a whole record after it", lambda: any(
            row["slot_start_ns"] > went_on and row["valid"] == 7 for row in self.rows()))
        daemon.send_signal(signal.SIGTERM)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        rows = self.rows()
        self.check_slots(rows)
        within = [row for row in rows if stopped < row["slot_start_ns"] < went_on]
        whole = [row for row in within if row["valid"] & 1]
        self.assertGreaterEqual(len(whole), 1, log)
        for row in whole:
            self.assertGreaterEqual(row["spd_span_s"], 0.9 * WINDOW_S, (row["idx"], log))
        still = [row["idx"] for row in within if row["spd_verdict"] == "the program stood still"]
        self.assertGreaterEqual(len(still), 4, log)  # the lines between hold no more
        self.assertEqual(len(whole) + len(still), len(within), log)

    def test_disk_full(self):
        def limit_file_size():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (512 << 10, 512 << 10))

        daemon = self.record("--set", "depth.address=", preexec_fn=limit_file_size, restore_signals=False)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 6, log)
        self.assertIn(f"{self.run}: ", log)
        rows = self.rows()
        self.assertGreater(len(rows), 3)
        self.check_slots(rows)
        self.assertEqual(self.info()["status"], "stopped:disk")

    def test_small_disk(self):
        disk = self.dir / "disk"
        disk.mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=640k", "tmpfs", disk], stderr=subprocess.DEVNULL).returncode:
            self.skipTest("no permission to mount a tmpfs")
        self.run = disk / "run.sqlite"
        try:
            daemon = self.record("--count", "100000", "--set", "depth.address=", "-v")
            log = self.finish(daemon)
            self.assertEqual(daemon.returncode, 6, log)
            self.assertRegex(log, r"warning disk: 100000 records need up to [\d.]+ MB, [\d.]+ [kM]B are free")
            rows = self.rows()
            self.assertGreater(len(rows), 3)
            self.assertGreaterEqual(len(rows), log.count(": committed"))
            self.check_slots(rows)
            self.assertEqual(self.info()["status"], "stopped:disk")
        finally:
            daemon.kill()
            daemon.wait()
            subprocess.run(["umount", disk], check=True)

    def test_removed_folder(self):
        folder = self.dir / "away"
        folder.mkdir()
        self.run = folder / "run.sqlite"
        daemon = self.record(cwd=self.dir)
        wait_for("records", lambda: self.committed() >= 2)
        folder.rename(self.dir / "elsewhere")
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 6, log)
        self.assertRegex(log, rf"was removed or renamed during the run; its \d+ records are in {self.dir}/run.rescued.sqlite")

    def test_close_in_5_s(self):
        """A slot that takes longer than SIGTERM allows is given up, and the run says that it was stopped."""
        daemon = self.record("--set", "run.window_s=60")
        wait_for("run", self.run.exists)
        wait_for("its tables", lambda: subprocess.run([bin_dir / "echofuse-acquire", "info", self.run],
                                                      stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0)
        self.assertEqual(self.info()["status"], "open")
        sent = time.monotonic()
        daemon.send_signal(signal.SIGTERM)
        log = self.finish(daemon)
        self.assertLess(time.monotonic() - sent, 5)
        self.assertEqual(daemon.returncode, 0, log)
        self.assertEqual((self.info()["status"], self.info()["records"]), ("stopped:interrupted", 0))

    def test_second_interrupt(self):
        daemon = self.record("--set", "run.window_s=2")
        wait_for("a record", lambda: self.committed() >= 1)  # 0.5 s of the next slot are over then
        daemon.send_signal(signal.SIGINT)
        time.sleep(0.2)  # two signals at once are one
        daemon.send_signal(signal.SIGINT)
        log = self.finish(daemon, 2)
        self.assertEqual(daemon.returncode, 130, log)
        self.assertEqual(self.info()["status"], "crashed")

    def test_resume(self):
        """After kill -9 and after a complete run the index goes on; another configuration is refused."""
        daemon = self.record("--meta", "room=2", "--meta", "note=a=b")
        wait_for("records", lambda: self.committed() >= 4)
        daemon.kill()
        daemon.wait()
        before = self.rows()
        log, code = self.resume("--set", "tdc.bins=99")
        self.assertEqual(code, 3, log)
        self.assertIn("tdc.bins was", log)
        self.assertEqual(self.info()["status"], "crashed")
        for total in (4, 8):
            log, code = self.resume("--count", "4", "--set", f"run.label=after {total}")
            self.assertEqual(code, 0, log)
            rows = self.rows()
            self.assertEqual([row["idx"] for row in rows], list(range(len(before) + total)))
            self.assertEqual([tuple(row) for row in rows[:len(before)]], [tuple(row) for row in before])
            utc = [row["slot_utc_ns"] for row in rows]
            self.assertEqual(utc, sorted(set(utc)))
            self.assertEqual(rows[-1]["label"], f"after {total}")
            self.assertIn(7, [row["valid"] for row in rows[len(before):]], log)
        log, code = self.resume("--count", "2")
        self.assertIn(f"2 of 2 records, {len(before) + 10} in all, complete", log)
        self.assertEqual([row["label"] for row in self.rows()[-2:]], ["after 8", "after 8"])
        info = self.info()
        self.assertEqual(info["status"], "complete")
        self.assertEqual(info["meta"], {"room": "2", "note": "a=b"})
        self.assertEqual([part["part"] for part in info["counters"]], [1, 2, 3])  # 0 was killed
        db = sqlite3.connect(self.run)
        gaps = [text for (text,) in db.execute("SELECT text FROM event WHERE text LIKE 'resumed%' ORDER BY id")]
        anchors = db.execute("SELECT count(*) FROM anchor").fetchone()[0]
        db.close()
        self.assertRegex(gaps[0], f"resumed at record {len(before)}, was crashed, .* after the last slot")
        self.assertRegex(gaps[1], f"resumed at record {len(before) + 4}, was complete, .* after the last slot")
        self.assertEqual(anchors, 4)

    def resume(self, *options):
        env = os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")}
        daemon = self.start([bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--resume",
                             self.run, *options], env=env, stderr=subprocess.PIPE, text=True)
        log = self.finish(daemon)
        return log, daemon.returncode

    def test_mark(self):
        """Another process remarks, labels, reads and exports while the run is written."""
        def tool(*command):
            return subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

        acquire = bin_dir / "echofuse-acquire"
        daemon = self.record("--set", "run.label=empty", "--set", "run.operator=Ada")
        wait_for("records", lambda: self.committed() >= 3)
        self.assertEqual(tool(acquire, "annotate", self.run, "door opens").returncode, 0)
        self.assertEqual(tool(acquire, "annotate", self.run, "--label", "person").returncode, 0)
        self.assertEqual(tool(acquire, "annotate", self.run).returncode, 2)
        self.assertEqual(tool(acquire, "run", "--config", self.dir / "lab/lab.toml", "--resume", self.run).returncode, 1)
        labelled = self.committed()
        wait_for("records", lambda: self.committed() >= labelled + 3)
        self.assertEqual(tool(acquire, "export", self.run, "--to", self.dir / "live.h5").returncode, 0)
        self.assertIn("Ada", tool(acquire, "info", self.run).stdout)
        # Somebody holds the file for longer than a slot: the rows wait, and none is lost.
        db = sqlite3.connect(self.run, isolation_level=None)
        db.execute("BEGIN IMMEDIATE")
        time.sleep(4 * WINDOW_S)
        db.execute("ROLLBACK")
        db.close()
        daemon.send_signal(signal.SIGINT)
        log = self.finish(daemon)
        self.assertEqual(daemon.returncode, 0, log)
        rows = self.rows()
        self.check_slots(rows)
        marked = next(m["utc"] for m in self.info()["marks"] if m["kind"] == "label")
        marked_ns = datetime.datetime.fromisoformat(marked.replace("Z", "+00:00")).timestamp() * 1e9
        for row in rows:
            after = row["slot_utc_ns"] + row["slot_end_ns"] - row["slot_start_ns"] - marked_ns
            if abs(after) > 2e6:  # what the time of a mark is rounded to
                self.assertEqual(row["label"], "person" if after > 0 else "empty", row["idx"])
        self.assertFalse([row for row in rows if row["spd_verdict"].startswith("dropped")], log)
        self.assertEqual([(m["kind"], m["text"]) for m in self.info()["marks"]],
                         [("note", "door opens"), ("label", "person")])
        self.assertEqual(tool(acquire, "annotate", self.run, "well done").returncode, 0)
        late = tool(acquire, "annotate", self.run, "--label", "too late")
        self.assertEqual((late.returncode, "nobody is recording" in late.stdout), (1, True))

    def test_devices(self):
        env = os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")}
        answer = subprocess.run([bin_dir / "echofuse-acquire", "devices", "--json", "--config",
                                 self.dir / "lab/lab.toml"], env=env, stdout=subprocess.PIPE, timeout=30)
        self.assertEqual(answer.returncode, 0)
        self.assertEqual([(d["sensor"], d["answers"]) for d in json.loads(answer.stdout)["configured"]],
                         [("spd", True), ("radar", True), ("depth", True)])


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"Live.{name}" for name in sys.argv[2:])])
