# SPDX-License-Identifier: MIT
"""Compares methods by accuracy, cost and stability, and runs the three-track benchmark.
`echofuse-bench --help` lists the kinds of methods.

>>> from echofuse import bench
>>> bench.measure(bench.method("nearest"), "train.sqlite", "test.sqlite")["iou"]
"""
from ..runs.programs import ProgramError, UsageError, call
from .command import main
from .methods import Method, evaluate, measure, method, python_method
from .table import Cell, RunSource, Table, existing_run, fill, markdown, means, pareto_cells

__all__ = ["Cell", "Method", "ProgramError", "RunSource", "Table", "UsageError", "call", "evaluate",
           "existing_run", "fill", "main", "markdown", "means", "measure", "method",
           "pareto_cells", "python_method"]
