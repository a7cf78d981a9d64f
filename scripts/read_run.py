#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/read_run.py RUN.sqlite [INDEX]: shows one record of a run (the last one if no index is given)."""
import sqlite3
import struct
import sys

db = sqlite3.connect(f"file:{sys.argv[1]}?mode=ro", uri=True)
db.row_factory = sqlite3.Row
record = db.execute("SELECT * FROM record WHERE idx = ifnull(?, (SELECT max(idx) FROM record))", (sys.argv[2:] or [None])[:1]).fetchone()
spd = struct.unpack(f"<{len(record['spd'] or b'') // 4}I", record["spd"] or b"")
radar = struct.unpack(f"<{len(record['radar'] or b'') // 4}f", record["radar"] or b"")
size = struct.unpack(">II", record["depth"][16:24]) if record["depth"] else ()  # of the PNG
start = {a["name"]: (a["start"], a["step"], a["unit"]) for a in db.execute("SELECT * FROM axis")}
peak = lambda name, v: "%.4g %s" % (start[name][0] + start[name][1] * v.index(max(v)), start[name][2]) if v else "-"
print(f"record {record['idx']}  valid mask {record['valid']}  label {record['label']!r}")
print(f"spd    {sum(spd)} counts in {len(spd)} bins, peak at {peak('spd', spd)}: {record['spd_verdict']}")
print(f"radar  {len(radar)} bins, peak at {peak('radar', radar)}: {record['radar_verdict']}")
print(f"depth  {' x '.join(map(str, size)) or '-'} pixels: {record['depth_verdict']}")
