# SPDX-License-Identifier: MIT
"""Figures for papers with matplotlib (python3-matplotlib), in the colours of the live page. Each
function returns a Figure; savefig("NAME.pdf") or savefig("NAME.svg") writes vector graphics. To
draw into your own figure, pass its axes as `ax`: one, or a sequence with one for each panel.

>>> from echofuse import plot
>>> plot.record("monday", 7).savefig("record.pdf")
>>> plot.pareto("pareto.csv").savefig("pareto.pdf")
"""
from .figures import (COLOURS, figure, learning_curve, map, maps, opened, pareto, record, shares,
                      stability, table, timeline)

__all__ = ["COLOURS", "figure", "learning_curve", "map", "maps", "opened", "pareto", "record",
           "shares", "stability", "table", "timeline"]
