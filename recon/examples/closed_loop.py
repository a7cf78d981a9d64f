#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""A closed loop: follows a run while it is recorded, and labels the slots that follow each record
by the range of its histogram's peak, so that the records are sorted when the run ends.

    echofuse-acquire run --out monday &
    python3 closed_loop.py monday
"""
import subprocess
import sys

import echofuse
import numpy as np

NEAR_M = 3.5
M_PER_PS = 299_792_458e-12 / 2  # two-way time


def label_of(record: echofuse.Record, centres_m: np.ndarray) -> str:
    """Put your own decision here: a device, an alarm, a servo."""
    counts = record.spd.reshape(-1, len(centres_m)).sum(0)
    return "near" if centres_m[counts.argmax()] < NEAR_M else "far"


def main(path: str) -> None:
    run = echofuse.open(path)
    label = ""
    for row in run.follow(pause_s=0.05):
        record, axis = run[row], run.axes.get("spd")
        if axis is None or not run.valid["spd"][row]:
            continue
        wanted = label_of(record, (axis.values + axis.step / 2) * M_PER_PS)
        print(f"record {record.index}: {wanted}", flush=True)
        if wanted != label:
            done = subprocess.run(["echofuse-acquire", "annotate", path, "--label", wanted])
            if done.returncode:
                break  # the run has ended
            label = wanted


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(sys.argv[1])
