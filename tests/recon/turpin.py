#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Converts the recordings of Turpin et al. (Optica 7, 900, 2020) to a run. Called as `turpin.py SIM FOLDER RUN`.
FOLDER contains histogram.npy [n, bins] and depth.npy [n, N, N], in fractions of the largest depth, which is set to 6 m."""
import contextlib
import pathlib
import sqlite3
import subprocess
import sys
import zlib

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fixtures"))
import fixtures  # noqa: E402

sim, folder, path = sys.argv[1:]
radar, depth = (numpy.load(f"{folder}/{name}.npy") for name in ("histogram", "depth"))
subprocess.run([sim, "dataset", "-q", "--people", "1", "--letters", "0", "--out", path], check=True)
# Keeps the tables and the map axes of the simulated run, but deletes its record.
with contextlib.closing(sqlite3.connect(path)) as run, run:
    fixtures.change(run, "empty run of a radar with ?1 range bins", radar.shape[1])
    for i, (power, z) in enumerate(zip(radar, depth)):
        mm = numpy.rint(numpy.clip(z, 0, 1) * 6000).astype("<u2")
        fixtures.change(run, "record ?1 with the range profile ?2 and the depth image ?3", i, power.astype("<f4").tobytes(),
                        zlib.compress(mm.tobytes()))
