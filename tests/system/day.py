#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Runs programs on a 24 h run with eight antennas and on a run of a tenth of this length. The processor time must grow
at most about linearly with the length of the run, and the memory much more slowly."""
import os
import shutil
import sqlite3
import subprocess

from case import SharedCase, bin_dir, call, main
from page_socket import Client

# Numbers of records in the simulated run, in a tenth of a day, and in a day.
MADE, TENTH, DAY = 240, 2_880, 28_800
# Memory in bytes that a program may use per additional record. A record takes 8 KiB.
MEMORY_A_RECORD = 1024
# Memory in bytes allowed for buffers and allocator overhead.
RESERVE = 16 << 20
# For ten times the number of records, a program may use 15 times the processor time, plus a constant time in s.
LONGER, START_S = 15, 0.5


def grow(run, out, records):
    """Copies the run and appends copies of its records until there are `records` records. Each copy is shifted by 12
    minutes relative to the previous copy."""
    shutil.copy(run, out)
    db = sqlite3.connect(out)
    columns = [row[1] for row in db.execute("PRAGMA table_info(record)")]
    values = ", ".join("idx + ?1" if name == "idx" else f"{name} + ?1 * 3000000000" if name.endswith("_ns") else name
                       for name in columns)
    for first in range(MADE, records, MADE):
        db.execute(f"INSERT INTO record SELECT {values} FROM record WHERE idx < {MADE}", (first,))
    db.commit()
    db.close()


class Day(SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        seed = cls.dir / "seed.sqlite"
        call(cls.dir, "echofuse-sim", "dataset", "-q", "--out", seed, "--records", MADE, "--set", "radar_antennas=8")
        call(cls.dir, "echofuse-recon", "-q", "train", seed, "--model", "factorised-4", "--out", "model")
        for records in TENTH, DAY:
            grow(seed, cls.dir / f"{records}.sqlite", records)

    def cost(self, command, use=None):
        """Runs a command and returns its processor time in s and its peak memory in bytes. If `use` is given, it is
        called with the command's first output line, and the command is then terminated."""
        with subprocess.Popen([bin_dir / command[0], *command[1:]], stdout=subprocess.PIPE, text=True) as process:
            if use:
                use(process.stdout.readline().strip())
                process.terminate()
            process.stdout.read()
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        self.assertEqual(process.returncode, 0, command)
        return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024

    def compare(self, command_of, use_of=lambda records: None):
        (short_s, small), (long_s, large) = (
            self.cost(command_of(self.dir / f"{records}.sqlite", records), use_of(records)) for records in (TENTH, DAY))
        print(f"{command_of('RUN', '')[:2]}: {short_s:.2f} s and {small >> 20} MiB, {long_s:.2f} s and {large >> 20} MiB", flush=True)
        self.assertLess(long_s, LONGER * short_s + START_S)
        self.assertLess(large - small, MEMORY_A_RECORD * (DAY - TENTH) + RESERVE)

    def test_info_time_and_memory_grow_at_most_linearly_with_run_length(self):
        self.compare(lambda run, _: ["echofuse-acquire", "info", run, "--json"])

    def test_reconstruct_time_and_memory_grow_at_most_linearly_with_run_length(self):
        self.compare(lambda run, records: ["echofuse-recon", "-q", "reconstruct", self.dir / "model", run, "--follow",
                                           "--format", "npy", "--out", self.dir / f"maps{records}"])

    def test_view_time_and_memory_grow_at_most_linearly_with_run_length(self):
        def look(records):
            def use(address):
                client = Client(address, timeout_s=300)
                self.assertEqual(client.until("state")["records"], records)
                self.assertTrue(client.until("strip")["arrays"]["first"])
                client.ask({"show": records // 2})
                self.assertEqual(client.until("record", lambda m: not m["live"])["index"], records // 2)
                client.ask({"sheet": [0, records]})
                # The viewer sends fewer rows than there are in the run, because a screen has a limited number of
                # pixels.
                self.assertLess(len(client.until("sheet")["index"]), TENTH)
                client.socket.close()
            return use
        self.compare(lambda run, _: ["echofuse-view", run, "--listen", "127.0.0.1:0", "--model", self.dir / "model"], look)


main(Day)
