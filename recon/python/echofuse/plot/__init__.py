# SPDX-License-Identifier: MIT
"""Draws figures for papers with matplotlib (python3-matplotlib), in the colours of the live page.
Each function returns a Figure; savefig("NAME.pdf") or savefig("NAME.svg") writes vector graphics.
To draw into your own figure, pass `ax`: one Axes object, or a sequence with one Axes per panel.

>>> from echofuse import plot
>>> plot.record("monday", 7).savefig("record.pdf")
>>> plot.pareto("pareto.csv").savefig("pareto.pdf")
"""
from .figures import (COLOURS, figure, learning_curve, map, maps, opened, pareto, record, shares,
                      stability, table, timeline)

__all__ = ["COLOURS", "figure", "learning_curve", "map", "maps", "opened", "pareto", "record",
           "shares", "stability", "table", "timeline"]
