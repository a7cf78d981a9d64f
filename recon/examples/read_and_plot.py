#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Plots the histogram and the range profile of one record, with the means over the run.

    python3 read_and_plot.py monday 3 monday.pdf
"""
import sys

import echofuse
import numpy as np
from matplotlib.figure import Figure


def draw(run: echofuse.Run, row: int) -> Figure:
    """Draws one panel per sensor with the data of the record and the mean over the run."""
    figure = Figure(figsize=(8, 3), layout="constrained")
    sensors = [name for name in ("spd", "radar") if name in run.axes]
    for ax, name in zip(np.atleast_1d(figure.subplots(1, len(sensors))), sensors):
        axis, values = run.axes[name], getattr(run, name)
        values = values.reshape(len(run), -1, axis.count).sum(1)  # sums the zones, if any
        ax.plot(axis.values, values[row], lw=.8, label=f"record {run.index[row]}")
        ax.plot(axis.values, values[run.valid[name]].mean(0), lw=.8, label="mean over the run")
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
