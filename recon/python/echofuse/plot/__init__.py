# SPDX-License-Identifier: MIT
"""Figures for papers, by matplotlib (python3-matplotlib), in the colours of the live page. Each
function returns a Figure; its savefig("NAME.pdf") or ("NAME.svg") writes vectors. ax: panels of a
figure of one's own to draw into, one or as many as the plot has.

>>> from echofuse import plot
>>> plot.record("monday", 7).savefig("record.pdf")
>>> plot.pareto("pareto.csv").savefig("pareto.pdf")
"""
from .figures import (COLOURS, figure, learning_curve, map, maps, opened, pareto, record, shares,
                      stability, table, timeline)

__all__ = ["COLOURS", "figure", "learning_curve", "map", "maps", "opened", "pareto", "record",
           "shares", "stability", "table", "timeline"]
