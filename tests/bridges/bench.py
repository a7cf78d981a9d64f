#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""bench.py [SECONDS]: how many tags a second scripts/bridges/timetagger.py serves to a client that only
reads, and what processor time it takes. The stand-in library always has a full buffer."""
import os
import struct
import sys
import time

import testing

import bridge

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
with testing.Program("timetagger.py", "--block-ms", "1", STAND_IN_PULSES_PER_S="inf") as program:
    with testing.Client(program.address) as client:
        client.until(bridge.TAGS)
        stat = f"/proc/{program.process.pid}/stat"
        ticks = lambda: sum(map(int, open(stat).read().rsplit(")", 1)[1].split()[11:13]))
        buffer = memoryview(bytearray(1 << 20))
        began, used, tags, dropped = time.monotonic(), ticks(), 0, 0
        while time.monotonic() < began + seconds:
            head = client.exactly(32)
            size, lost = struct.unpack_from("<IQ", head, 12)
            left = size
            while left:
                left -= client.socket.recv_into(buffer[:left])
            tags += size // 16
            dropped += lost
        took = time.monotonic() - began
        share = (ticks() - used) / os.sysconf("SC_CLK_TCK") / took
    program.stop()
print(f"{tags / took / 1e6:.1f} Mtags/s arrived, {dropped / took / 1e6:.1f} Mtags/s dropped at the sender; "
      f"the bridge used {100 * share:.0f} % of a core")
