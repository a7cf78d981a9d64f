#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Reads a run and plots one record: mean histogram and profile of the run, and the record's own.

    python3 read_and_plot.py monday 3 monday.pdf
"""
import sys

import echofuse
import numpy as np
from matplotlib.figure import Figure


def draw(run: echofuse.Run, row: int) -> Figure:
    """One panel a sensor: the record's values and the run's mean."""
    figure = Figure(figsize=(8, 3), layout="constrained")
    sensors = [name for name in ("spd", "radar") if name in run.axes]
    for ax, name in zip(np.atleast_1d(figure.subplots(1, len(sensors))), sensors):
        axis, values = run.axes[name], getattr(run, name)
        values = values.reshape(len(run), -1, axis.count).sum(1)  # zones, if there are any
        ax.plot(axis.values, values[row], lw=.8, label=f"record {run.index[row]}")
        ax.plot(axis.values, values[run.valid[name]].mean(0), lw=.8, label="mean of the run")
        ax.set(xlabel=f"{name}, {axis.unit}", ylabel=axis.quantity, yscale="log")
        ax.legend()
    return figure


def main(path: str, row: str, out: str) -> None:
    run = echofuse.open(path)
    print(run)
    draw(run, int(row)).savefig(out)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
