#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests the daemon with the simulated laboratory. The daemon uses TCP, two pseudo-terminals and the unmodified OpenNI2
library."""
import contextlib
import fcntl
import json
import os
import pathlib
import pty
import re
import signal
import sqlite3
import struct
import subprocess
import termios
import threading
import time

from case import Case, bin_dir, main
import fixtures
from waiting import not_checked, starved, wait_for

def viewers_of(path):
    """Returns the process IDs of the viewers of runs with a path that begins with `path`. Ports do not identify the
    viewers, because another test may reuse a port."""
    out = []
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # the process may have ended
            name, *words = (process / "cmdline").read_text(encoding="utf-8", errors="replace").split("\0")
            if name.endswith("/echofuse-view") and any(word.startswith(str(path)) for word in words):
                out.append(int(process.name))
    return out


# Sanitizers make the programs slower, so longer slots are needed.
WINDOW_S = float(os.environ.get("ECHOFUSE_TEST_WINDOW_S", "0.2"))


SEQUENCES = re.compile(r"\x1b\[[0-9;]*[A-Za-z]|\x07")


class Output:
    """Reads all output of a program from a pipe or a pseudo-terminal."""

    def __init__(self, end):
        self.text = ""
        self.reader = threading.Thread(target=self.read, args=(end,), daemon=True)
        self.reader.start()

    def read(self, end):
        with contextlib.suppress(OSError):  # the last program has closed its end of the pseudo-terminal
            while data := os.read(end, 4096):
                self.text += data.decode()


class Terminal(Output):
    def __init__(self, columns):
        self.master, self.slave = pty.openpty()
        self.resize(columns)
        super().__init__(self.master)

    def resize(self, columns):
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 25, columns, 0, 0))

    def end(self, daemon):
        """Waits for the end of the daemon. Returns its exit code."""
        daemon.wait(40)
        os.close(self.slave)
        self.reader.join(10)
        os.close(self.master)
        return daemon.returncode

    def status_lines(self):
        """Returns the status lines printed so far, which are separated by carriage returns."""
        parts = re.split(r"[\r\n]+", SEQUENCES.sub("", self.text))
        return [part for part in parts if part.startswith("record ")]


class Live(Case):
    # A scene lasts two slots. With this laser rate, there are few clicks per pulse even in short slots.
    lab_options = ("--hold", str(2 * WINDOW_S), "--laser-rate-hz", "2e7", "--set", "signal_photons=5e4")

    def setUp(self):
        super().setUp()
        self.run = self.dir / "run.sqlite"
        self.processes = []
        self.lab = self.start_lab(self.dir / "lab", *self.lab_options, "--log", self.dir / "sent.jsonl")

    def start_lab(self, folder, *options, scene="mixed"):
        with open(self.dir / "lab.log", "w") as log:
            lab = self.start([bin_dir / "echofuse-sim", "lab", "--dir", folder, "--scene", scene, "--window", WINDOW_S, *options],
                             stdout=log, stderr=log)
        wait_for("lab.toml", lambda: (folder / "lab.toml").exists() or lab.poll() is not None)
        self.assertIsNone(lab.poll(), (self.dir / "lab.log").read_text())
        return lab

    def tearDown(self):
        # The daemon must end before the laboratory, because another test may reuse the pseudo-terminals and needs to
        # lock them.
        for process in reversed(self.processes):
            if process.poll() is None:
                process.kill()
            process.communicate()

    def start(self, command, **streams):
        process = subprocess.Popen(list(map(str, command)), **streams)
        self.processes.append(process)
        return process

    def environment(self, **more):
        """Returns the environment of programs that use the OpenNI2 library of the laboratory."""
        return os.environ | {"LD_LIBRARY_PATH": str(self.dir / "lab/openni")} | more

    def record(self, *options, **how):
        return self.start([bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--out",
                           self.run.with_suffix(""), *options],
                          **{"env": self.environment(), "stderr": subprocess.PIPE, "text": True} | how)

    def acquire(self, command, *options, config="lab/lab.toml"):
        return fixtures.outcome("echofuse-acquire", command, "--config", self.dir / config, *options, env=self.environment(),
                                timeout=60)

    def finish(self, daemon, how=None, code=0, timeout_s=30):
        """Sends the signal `how`, if any, and waits for the end of the daemon. Checks the exit code, except for None.
        Returns the log."""
        if how:
            daemon.send_signal(how)
        log = daemon.communicate(timeout=timeout_s)[1]
        self.assertIn(code, (None, daemon.returncode), log)
        return log

    def close_lab(self):
        self.lab.send_signal(signal.SIGINT)
        self.assertEqual(self.lab.wait(10), 0)
        return json.loads((self.dir / "lab/sent.json").read_text())

    def info(self):
        return fixtures.json_of("echofuse-acquire", "info", self.run)

    def rows(self):
        return fixtures.query(self.run, "SELECT * FROM record ORDER BY idx", by_name=True)

    def committed(self):
        try:
            return len(self.rows())
        except sqlite3.Error:
            daemon = self.processes[-1]
            if daemon.poll():
                raise AssertionError(f"exit {daemon.returncode}: {daemon.stderr.read() if daemon.stderr else ''}")
            return 0

    @staticmethod
    def complete(rows):
        return [row for row in rows if row["valid"] == 7 and not any(row[f"{s}_lost"] for s in ("spd", "radar", "depth"))]

    def check_slots(self, rows):
        """Checks that the rows are consecutive slots, and that each tag is counted exactly once."""
        window_ns = round(WINDOW_S * 1e9)
        for k, row in enumerate(rows):
            begin_ns = rows[0]["slot_start_ns"] + k * window_ns
            tags = sum(row[kind] for kind in ("starts", "in_range", "out_of_range", "without_start", "other"))
            self.assertEqual((row["idx"], row["slot_start_ns"], row["slot_end_ns"], row["tags"]),
                             (k, begin_ns, begin_ns + window_ns, tags))
            if row["valid"] & 1:
                counts = struct.unpack(f"<{len(row['spd']) // 4}I", row["spd"])
                self.assertEqual(sum(counts), row["in_range"])

    def test_daemon_records_ten_complete_slots(self):
        daemon = self.record("--count", "1000", "--set", "run.label=person", "--set", "depth.map_size=96")
        # On a busy machine, the laboratory and the daemon get too little processor time to complete the records.
        wait_for("ten complete records", lambda: self.committed() and (
            len(self.complete(self.rows())) >= 10 or self.committed() >= 40 and starved(self.lab.pid, daemon.pid)), 200, 0.1)
        late = starved(self.lab.pid, daemon.pid)
        log = self.finish(daemon, signal.SIGTERM)
        sent, rows, info = self.close_lab(), self.rows(), self.info()
        self.check_slots(rows)
        self.assertEqual((info["records"], info["status"], info["labels"]), (len(rows), "complete", {"person": len(rows)}))
        # The tagger also sends tags while the radar is configured and after the last slot.
        self.assertLessEqual(info["tags"], sent["tdc"]["tags"])
        profiles = [row["radar"] for row in rows if row["valid"] & 2]
        self.assertEqual(len(set(profiles)), len(profiles))
        self.assertLessEqual(sum(row["radar_used"] for row in rows), sent["radar"]["frames"])
        self.assertGreater(info["tags"], 0)
        counts = {axis["name"]: axis["count"] for axis in info["axes"]}
        self.assertEqual((counts["depth_x"], counts["map_x"], counts["map_y"]), (320, 96, 96))
        if late:
            return not_checked("completeness of the slots", late)
        self.assertEqual((len(self.complete(rows)), info["events"], sent["tdc"]["dropped"]), (len(rows), {}, 0), log)
        self.assertRegex(log, r"record \d+/1000  SRD")
        # The three devices use the same time base, and their delays are below 10 ms.
        offsets = [info["clocks"][sensor]["offset_s"] for sensor in info["clocks"]]
        self.assertIn("spd", info["clocks"])
        self.assertLess(max(offsets) - min(offsets), 0.01, info["clocks"])

    def test_terminal_hangup_ends_each_device_command(self):
        config = ("--config", self.dir / "lab/lab.toml")
        commands = {"run": ("run", *config, "--out", self.run.with_suffix(""), "--count", "1000"),
                    "calibrate": ("calibrate", *config, "--time", "50"), "doctor": ("doctor", *config)}
        for name, words in commands.items():
            sent = self.frames()
            program = self.start([bin_dir / "echofuse-acquire", *words], env=self.environment(), stdout=subprocess.PIPE,
                                 stderr=subprocess.PIPE, text=True)
            wait_for("frames of the radar", lambda: self.catches_hangup(program) and self.frames() > sent + 4)
            if name == "run":
                wait_for("a record", self.committed)
            program.send_signal(signal.SIGHUP)
            said = program.communicate(timeout=20)[1]
            self.assertEqual(program.returncode, 0 if name == "run" else 130, (name, said))
            wait_for(f"the radar to stop after {name}", self.silent)
        self.assertEqual((self.info()["status"], self.info()["records"]), ("complete", len(self.rows())))
        ignoring = self.start(["nohup", bin_dir / "echofuse-acquire", *commands["run"][:4], self.dir / "kept", "--count", "8"],
                              env=self.environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for("run file", (self.dir / "kept.sqlite").exists)
        ignoring.send_signal(signal.SIGHUP)
        self.assertEqual(ignoring.wait(30), 0)
        self.run = self.dir / "kept.sqlite"
        self.assertEqual(self.info()["records"], 8)

    @staticmethod
    def catches_hangup(program):
        status = pathlib.Path(f"/proc/{program.pid}/status").read_text()
        return int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16) & 1 << signal.SIGHUP - 1

    def silent(self):
        sent = self.frames()
        time.sleep(0.5)
        return self.frames() == sent

    def frames(self):
        return (self.dir / "sent.jsonl").read_text().count('"radar"')

    def test_blocked_terminal_or_pipe_does_not_stop_a_run(self):
        for what in "released", "held", "gone":
            master, slave = pty.openpty()
            reader, writer = os.pipe()
            fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
            if what == "gone":
                os.close(reader)
                os.close(master)
            else:
                os.write(writer, b"\n" * 4096)
                os.write(master, b"\x13")  # Ctrl-S stops the terminal.
            self.run = self.dir / f"{what}.sqlite"
            daemon = self.record("--json", "-v", "--count", "22", env=self.environment(TERM="xterm"), stdout=writer, stderr=slave)
            os.close(writer)
            os.close(slave)
            wait_for("records", lambda: self.committed() >= 14)
            if what == "released":
                os.write(master, b"\x11")
                terminal, pipe = Output(master), Output(reader)
                terminal.reader.join(30)
                pipe.reader.join(30)
            self.assertEqual(daemon.wait(30), 0, what)
            self.assertEqual((self.info()["status"], self.info()["records"]), ("complete", 22), what)
            self.check_slots(self.rows())
            if what == "released":
                first, *events, end = [json.loads(line) for line in pipe.text.split()]
                self.assertEqual((first["event"], end["event"], end["on_disk"], end["code"]), ("run", "end", 22, 0))
                # One event may report several records that were written together.
                counts = [event["on_disk"] for event in events]
                self.assertEqual((counts, counts[-1]), (sorted(set(counts)), 22))
                # The dropped lines are status lines.
                for words in ("21: committed", "22 of 22 records, complete", r"\d+ log lines dropped \(terminal blocked\)"):
                    self.assertRegex(terminal.text, words)

    def test_notes_and_labels_can_be_added_to_a_live_run(self):
        def annotate(*words):
            done = fixtures.outcome("echofuse-acquire", "annotate", self.run, *words)
            return f"{done.returncode}: {done.stdout}{done.stderr}"

        daemon = self.record("--set", "run.label=empty")
        wait_for("records", lambda: self.committed() >= 3)
        self.assertRegex(annotate("door\x1b[2J opened"), r'^0: .*: "door\\x1b\[2J opened" noted in record \d+\n$')
        told = annotate("--label", "person")
        first = int(re.fullmatch(rf'0: {re.escape(str(self.run))}: label "person" from record (\d+) on\n', told)[1])
        wait_for("records", lambda: self.committed() >= first + 3)
        self.call("echofuse-export", self.run, "--to", "live.h5")
        self.finish(daemon, signal.SIGINT)
        rows = self.rows()
        self.check_slots(rows)
        self.assertEqual((self.info()["status"], pathlib.Path(f"{self.run}-wal").exists()), ("complete", False))
        labels = [row["label"] for row in rows]
        begin = labels.index("person")
        self.assertEqual(labels, ["empty"] * begin + ["person"] * (len(labels) - begin))
        # A slot may end between the request and the response.
        self.assertLessEqual(abs(begin - first), 1)
        self.assertRegex(annotate("well done"), "^0: ")

    def test_run_refuses_radar_ports_of_two_boards(self):
        other = self.dir / "other"
        self.start_lab(other, scene="reflector")

        alone = "--set", "tdc.address=", "--set", "depth.address=", "--set", "radar.keep_running=true"
        started = self.acquire("run", *alone, "--out", self.dir / "b", "--count", "2", config="other/lab.toml")
        self.assertEqual(started.returncode, 0, started.stderr)
        mixed, right = {"config": "lab/mixed.toml"}, (self.dir / "lab/lab.toml").read_text()
        (self.dir / "lab/mixed.toml").write_text(re.sub(r"(?m)^data = .*", f'data = "serial:{other}/radar-data"', right))
        listed = json.loads(self.acquire("devices", "--json", **mixed).stdout)["configured"]
        self.assertEqual([device["state"] for device in listed], ["streaming", "misconfigured", "streaming"], listed)
        checked = self.acquire("doctor", "--json", **mixed)
        radar, = (check for check in json.loads(checked.stdout)["checks"] if check["check"] == "radar")
        self.assertRegex(f"{radar['found']}: {radar['advice']}", "ports of two different boards.*: correct the configuration")
        refused = self.acquire("run", "--out", self.run, "--count", "2", **mixed)
        self.assertIn("radar.cli and radar.data are ports of two different boards", refused.stderr)
        self.assertEqual((checked.returncode, refused.returncode, self.run.exists()), (3, 3, False))

    def test_commands_report_that_a_device_is_in_use_by_a_run(self):
        """`run`, `calibrate`, `devices` and `doctor` report which run is using the devices, and this run loses no
        data. The commands can still use the camera, which is not part of the run."""
        daemon = self.record("--count", "30", "--set", "depth.address=")
        wait_for("records", lambda: self.committed() >= 3)
        holder = f"in use by echofuse-acquire run, pid {daemon.pid}, run {self.run}"
        second = "run", "--out", self.dir / "second"
        # `run` reports that the ports are in use even if the configuration contains different paths to the same ports.
        cli, data = ((self.dir / "lab" / name).resolve() for name in ("radar-cli", "radar-data"))
        other = ("--set", f"radar.cli=serial:{cli}", "--set", f"radar.data=serial:{data}", "--set", "tdc.address=",
                 "--set", "depth.address=", "--set", "run.connect_timeout_s=0.5")
        plain = rf"{{}} [^\n]*{re.escape(holder)}"
        in_doctor = rf"warning +{{}} +{re.escape(holder)}; record \d+, [\d.]+ s ago: \w+"
        for code, words, *command in (
                (4, plain, *second), (4, plain, "calibrate", "--set", f"run.calibration={self.dir}/c.toml"),
                (4, "in use by another program", *second, *other), (0, plain, "devices"),
                (0, in_doctor, "doctor", "--set", f"run.folder={self.dir}", "--duration", "10s")):
            done = self.acquire(*command)
            said = done.stdout + done.stderr
            self.assertEqual(done.returncode, code, said)
            for sensor in "spd", "radar":
                self.assertRegex(said, words.format(sensor))
        self.assertFalse((self.dir / "second.sqlite").exists())
        *taken, free = json.loads(self.acquire("devices", "--json").stdout)["configured"]
        self.assertEqual((free["sensor"], free["state"], free["answers"]), ("depth", "streaming", True))
        for device in taken:
            self.assertEqual((device["state"], device["answers"], device["run"]), ("in use", True, str(self.run)))
            self.assertRegex(device["last_event"], rf"{re.escape(holder)}; record \d+, [\d.]+ s ago: [^,]+, \d+ ")

        log = self.finish(daemon)
        self.check_slots(self.rows())
        self.assertEqual(len(self.rows()), 30)
        self.assertNotRegex(log, r"warning (spd|radar): (?!record|did not confirm)")
        lost = self.info()["lost"]
        self.assertEqual(lost["spd"], 0, log)
        # The devices are free after the run.
        listed = json.loads(self.acquire("devices", "--json").stdout)["configured"]
        self.assertEqual([device["state"] for device in listed], ["streaming"] * 3)
        # No frame is lost in transport, but the simulated board may skip frames on a busy machine.
        self.assertLessEqual(lost["radar"], self.close_lab()["radar"]["frames_skipped"], log)

    def test_status_line_does_not_wrap_in_a_narrow_terminal(self):
        records, terminal = round(8 / WINDOW_S), Terminal(300)
        daemon = self.record("--duration", "0.1m2s", "--set", "run.label=" + "person " * 20, env=self.environment(TERM="xterm"), stderr=terminal.slave)
        drawn = {}
        for columns in 300, 80, 40:
            terminal.resize(columns)
            before = len(terminal.status_lines())
            wait_for("status", lambda: len(terminal.status_lines()) >= before + 3, 40)
            # The first of these status lines may have been printed before the terminal was resized.
            drawn[columns] = terminal.status_lines()[before + 1:]
        self.assertEqual(terminal.end(daemon), 0)
        text = terminal.text
        for columns, lines in drawn.items():
            self.assertTrue(all(len(line) < columns for line in lines), lines)
        for field in rf"record \d+/{records}  [sS-][rR-][dD-]  ", r"  0:0\d, 0:0\d left  ", "  person person ":
            self.assertRegex(drawn[300][-1], field)
        self.assertTrue(all(re.match(rf"record \d+/{records}  ", line) for line in drawn[40]), drawn)
        # Only log messages and the last status line end with a line feed.
        lines = SEQUENCES.sub("", text).replace("\r\n", "\n").split("\n")
        feeds = [line.rsplit("\r", 1)[-1] for line in lines[:-1]]
        self.assertEqual([f.split("  ")[0] for f in feeds if f.startswith("record ")], [f"record {records}/{records}"], text)

    def test_second_ctrl_c_ends_the_run_immediately(self):
        terminal = Terminal(80)
        daemon = self.record("--set", "run.window_s=3", env=self.environment(TERM="xterm"), stderr=terminal.slave)
        wait_for("a record", lambda: self.committed() >= 1)
        asked = time.monotonic()
        daemon.send_signal(signal.SIGINT)
        answer = r"finishing the slot, [\d.]+ s left; press Ctrl-C again to stop immediately"
        wait_for("an answer", lambda: re.search(answer, terminal.text), 1)
        daemon.send_signal(signal.SIGINT)
        self.assertEqual(terminal.end(daemon), 130)
        self.assertLess(time.monotonic() - asked, 2)
        self.assertEqual(self.info()["status"], "crashed")


if __name__ == "__main__":
    main(Live)
