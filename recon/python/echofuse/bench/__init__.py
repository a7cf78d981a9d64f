# SPDX-License-Identifier: MIT
"""Methods side by side: accuracy against cost, stability, and the recipe of three tracks
(`echofuse-bench --help`; method() has the kinds of methods).

>>> from echofuse import bench
>>> bench.measure(bench.method("nearest"), "train.sqlite", "test.sqlite")["iou"]
"""
from ..runs.programs import BenchError, UsageError, call
from .command import main
from .methods import Method, judge, measure, method, python_method
from .table import Cell, Source, Table, fill, markdown, means, pareto_cells, there

__all__ = ["BenchError", "Cell", "Method", "Source", "Table", "UsageError", "call", "fill",
           "judge", "main", "markdown", "means", "measure", "method", "pareto_cells",
           "python_method", "there"]
