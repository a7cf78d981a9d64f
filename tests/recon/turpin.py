#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""turpin.py SIM FOLDER RUN: converts the recordings of Turpin et al. (Optica 7, 900, 2020) to a run. FOLDER contains
histogram.npy [n, bins] and depth.npy [n, N, N]; depths in units of the scene's maximum are scaled to 6 m."""
import sqlite3
import subprocess
import sys
import zlib

import numpy


sim, folder, path = sys.argv[1:]
radar, depth = (numpy.load(f"{folder}/{name}.npy") for name in ("histogram", "depth"))
subprocess.run([sim, "dataset", "-q", "--people", "1", "--letters", "0", "--out", path], check=True)
with sqlite3.connect(path) as run:  # keeps the tables and map axes, but not the simulated record
    for table in ("record", "calibration", "axis WHERE name NOT LIKE 'depth%'"):
        run.execute(f"DELETE FROM {table}")
    run.execute("UPDATE run SET meta = '{}'")
    run.execute("INSERT INTO axis VALUES ('radar', 'power', 'bin', ?, 0, 1, 1)", (radar.shape[1],))
    run.executemany("INSERT INTO record (idx, valid, radar_verdict, depth_verdict, radar, depth) VALUES (?, 6, 'ok', 'ok', ?, ?)", [
        (i, power.astype("<f4").tobytes(), zlib.compress(numpy.rint(numpy.clip(z, 0, 1) * 6000).astype("<u2").tobytes()))
        for i, (power, z) in enumerate(zip(radar, depth))])
