#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""bench.py BIN_DIR [SECONDS=8]: measures the tag rate of scripts/bridges/timetagger.py and the cost of live runs.

Costs are processor times, because wall-clock times depend on the load of the machine. The cost of generating tags in the
stand-in is listed separately."""
import os
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import time

import testing

import bridge
from fixtures import query
import TimeTagger as library

SECONDS = 3.0
SLOTS = int(sys.argv[2]) if len(sys.argv) > 2 else 8
daemon_program = pathlib.Path(sys.argv[1]) / "echofuse-acquire"


def cpu_s(process):
    fields = pathlib.Path(f"/proc/{process.pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


# The client only reads, and the buffer of the stand-in library is always full.
def reading():
    with testing.Program("timetagger.py", "--block-ms", "1", STAND_IN_PULSES_PER_S="inf") as program:
        with testing.Client(program.address) as client:
            client.until(bridge.TAGS)
            buffer = memoryview(bytearray(1 << 20))
            began, used, tags, dropped = time.monotonic(), cpu_s(program.process), 0, 0
            while time.monotonic() < began + SECONDS:
                size, lost = struct.unpack_from("<IQ", client.exactly(32), 12)
                left = size
                while left:
                    left -= client.socket.recv_into(buffer[:left])
                tags += size // 16
                dropped += lost
            took = time.monotonic() - began
            share = (cpu_s(program.process) - used) / took
        program.stop()
    print(f"bridge to a plain reader: {tags / took / 1e6:.1f} Mtags/s arrived, {dropped / took / 1e6:.1f} Mtags/s "
          f"dropped at the sender; the bridge used {100 * share:.0f} % of a core")


# Every tag that the bridge sends must be in a record of the daemon.
def live(offered):
    pulses = offered * library.PULSES / library.PATTERN_TAGS
    with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
        config, run, made = (pathlib.Path(folder) / name for name in ("lab.toml", "run.sqlite", "cpu"))
        with testing.Program("timetagger.py", "--block-ms", "5", STAND_IN_PULSES_PER_S=str(pulses),
                             STAND_IN_CPU=str(made)) as program:
            testing.config(config, 1.0, tdc=program)
            daemon = subprocess.Popen([daemon_program, "run", "--config", config, "--out", run, "--count", str(SLOTS)],
                                      stderr=subprocess.PIPE, text=True)
            time.sleep(SLOTS - 2)
            used = cpu_s(program.process), cpu_s(daemon)
            program.stop()  # the bridge prints the number of tags sent
            log = daemon.communicate()[1]
            sent, _, dropped = program.sent()
        arrived = int(re.search(r"received: (\d+) tags", log).group(1))
        rows = query(run, "SELECT tags, spd_lost FROM record WHERE tags > 0")
        (missed,), = query(run, "SELECT sum(spd_missed) FROM record")  # tags missed by the tagger itself
        (strays,), = query(run, "SELECT sum(value) FROM counter WHERE source = 'spd' AND name IN ('early', 'late', 'outside')")
        making = float(made.read_text(encoding="utf-8"))
    lost = sum(row[1] for row in rows) - missed
    full = sorted(row[0] for row in rows)[len(rows) // 2]
    recorded = sum(row[0] for row in rows) + strays
    # The bridge also packs the tags that it drops.
    cost = [1e9 * s / tags for s, tags in ((used[0] - making, sent + dropped), (used[1], sent), (making, sent + dropped))]
    print(f"live run, {offered / 1e6:.0f} Mtags/s offered: {full / 1e6:.1f} Mtags in the median slot of 1 s; {sent} "
          f"sent, {arrived} arrived, {dropped} dropped by the bridge, {lost} lost according to the records; a tag costs "
          f"{cost[0]:.1f} ns in the bridge and {cost[1]:.1f} ns in the daemon, {100e-9 * offered * (cost[0] + cost[1]):.0f} % "
          f"of a core at this rate; {cost[2]:.1f} ns its generation")
    if sent != arrived or arrived != recorded or lost > dropped:
        sys.exit(f"unaccounted: {sent} sent, {arrived} arrived, {recorded} recorded")


reading()
for rate in (40e6, 90e6):
    live(rate)
