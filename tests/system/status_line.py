#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests the daemon's status line in pseudo-terminals of different widths."""
import fcntl
import os
import pty
import re
import signal
import struct
import termios
import threading
import time

import live
from live import wait_for

SEQUENCES = re.compile(r"\x1b\[[0-9;]*[A-Za-z]|\x07")


class Terminal:
    """Master side of a pseudo-terminal. Stores all output of the program."""

    def __init__(self, columns):
        self.master, self.slave = pty.openpty()
        self.resize(columns)
        self.text = ""
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def resize(self, columns):
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 25, columns, 0, 0))

    def read(self):
        while True:
            try:
                data = os.read(self.master, 4096)
            except OSError:  # the last program has closed its end of the pseudo-terminal
                return
            self.text += data.decode()

    def close(self):
        os.close(self.slave)
        self.reader.join(10)
        os.close(self.master)

    def status_lines(self):
        """Returns the status lines printed so far, which are separated by carriage returns."""
        parts = re.split(r"[\r\n]+", SEQUENCES.sub("", self.text))
        return [part for part in parts if part.startswith("record ")]


class StatusLine(live.Live):
    def setUp(self):
        pass  # Each test starts its own laboratory.

    def run_at_terminal(self, columns, *options):
        live.Live.setUp(self)
        self.terminal = Terminal(columns)
        return self.record(*options, env=self.environment(TERM="xterm"), stderr=self.terminal.slave)

    def end(self, daemon):
        daemon.wait(40)
        self.terminal.close()
        return daemon.returncode

    def test_status_line_does_not_wrap_in_a_narrow_terminal(self):
        """Status lines do not wrap at any width, and each status line overwrites the previous one."""
        records = round(8 / live.WINDOW_S)
        daemon = self.run_at_terminal(300, "--duration", "8s", "--set", "run.label=" + "person " * 20)
        drawn = {}
        for columns in 300, 80, 40:
            self.terminal.resize(columns)
            before = len(self.terminal.status_lines())
            wait_for("status", lambda: len(self.terminal.status_lines()) >= before + 3, 40)
            # The first of these status lines may have been printed before the terminal was resized.
            drawn[columns] = self.terminal.status_lines()[before + 1:]
        self.assertEqual(self.end(daemon), 0)
        text = self.terminal.text
        for columns, lines in drawn.items():
            self.assertTrue(all(len(line) < columns for line in lines), lines)
        whole = drawn[300][-1]
        fields = (rf"record \d+/{records}  [sS-][rR-][dD-]  ", r"  0:0\d, 0:0\d left  ", r"  \d+\.\d ktag/s  ", r"  radar \d+\.\d fps \d+ dB  ",
                  r"  depth \d+\.\d fps  ", r"  lost (0|[SRD] \d)", r"  [\d.]+ GB free  ", r"  person person ")
        for field in fields:
            self.assertRegex(whole, field)
        self.assertTrue(all(re.match(fields[0], line) for line in drawn[40]), drawn)
        # Only log messages and the last status line end with a line feed.
        lines = SEQUENCES.sub("", text).replace("\r\n", "\n").split("\n")
        feeds = [line.rsplit("\r", 1)[-1] for line in lines[:-1]]
        self.assertEqual([f.split("  ")[0] for f in feeds if f.startswith("record ")], [f"record {records}/{records}"], text)

    def test_second_ctrl_c_ends_the_run_immediately(self):
        """The first Ctrl-C prints a message, and the second Ctrl-C ends the run immediately."""
        daemon = self.run_at_terminal(80, "--set", "run.window_s=3")
        wait_for("a record", lambda: self.committed() >= 1)
        asked = time.monotonic()
        daemon.send_signal(signal.SIGINT)
        wait_for("an answer", lambda: "finishing the slot, " in self.terminal.text)
        self.assertLess(time.monotonic() - asked, 1)
        self.assertRegex(self.terminal.text, r"finishing the slot, [\d.]+ s left; press Ctrl-C again to stop immediately")
        daemon.send_signal(signal.SIGINT)
        self.assertEqual(self.end(daemon), 130)
        self.assertLess(time.monotonic() - asked, 2)
        self.assertEqual(self.info()["status"], "crashed")


live.main(StatusLine)
