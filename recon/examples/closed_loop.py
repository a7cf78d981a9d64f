#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Example of a closed loop. Follows a run while it is being recorded. After each record, labels
the following slots "near" or "far" by the range of the record's histogram peak.

    echofuse-acquire run --out monday &
    python3 closed_loop.py monday
"""
import sys

import echofuse
import numpy as np

NEAR_M = 3.5
M_PER_PS = 299_792_458e-12 / 2  # metres of range per picosecond of two-way time


def label_of(record: echofuse.Record, centres_m: np.ndarray) -> str:
    """Returns "near" or "far". Replace this function to control a device, an alarm or a servo."""
    counts = record.spd.reshape(-1, len(centres_m)).sum(0)
    return "near" if centres_m[counts.argmax()] < NEAR_M else "far"


def main(path: str) -> None:
    run = echofuse.open(path)
    label = ""
    for row in run.follow(pause_s=0.05):
        record, axis = run[row], run.axes.get("spd")
        if axis is None or not run.valid["spd"][row]:
            continue
        new_label = label_of(record, (axis.values + axis.step / 2) * M_PER_PS)
        print(f"record {record.index}: {new_label}", flush=True)
        if new_label != label:
            try:
                echofuse.annotate(run, label=new_label)
            except RuntimeError:
                break  # the run has ended
            label = new_label


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(sys.argv[1])
