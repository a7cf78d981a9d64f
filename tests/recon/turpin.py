#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Converts the recordings of Turpin et al. (Optica 7, 900, 2020) to a run. Called as `turpin.py SIM FOLDER RUN`.
FOLDER contains histogram.npy [n, bins] and depth.npy [n, N, N]. The depths are fractions of the scene's largest
depth, which is set to 6 m."""
import sqlite3
import subprocess
import sys
import zlib

import numpy


sim, folder, path = sys.argv[1:]
radar, depth = (numpy.load(f"{folder}/{name}.npy") for name in ("histogram", "depth"))
subprocess.run([sim, "dataset", "-q", "--people", "1", "--letters", "0", "--out", path], check=True)
# Keeps the tables and the map axes of the simulated run, but deletes its record.
with sqlite3.connect(path) as run:
    for table in ("record", "calibration", "axis WHERE name NOT LIKE 'depth%'"):
        run.execute(f"DELETE FROM {table}")
    run.execute("UPDATE run SET meta = '{}'")
    run.execute("INSERT INTO axis VALUES ('radar', 'power', 'bin', ?, 0, 1, 1)", (radar.shape[1],))
    run.executemany("INSERT INTO record (idx, valid, radar_verdict, depth_verdict, radar, depth) VALUES (?, 6, 'ok', 'ok', ?, ?)", [
        (i, power.astype("<f4").tobytes(), zlib.compress(numpy.rint(numpy.clip(z, 0, 1) * 6000).astype("<u2").tobytes()))
        for i, (power, z) in enumerate(zip(radar, depth))])
