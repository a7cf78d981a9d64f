# SPDX-License-Identifier: MIT
"""Methods side by side: accuracy against cost (pareto), where each fails (stability), and the
bench of three tracks that anybody can make again (run).

A method is one of::

    factorised-16, mlp-512-256:spd   a candidate of `echofuse-recon train`, perhaps with its inputs
    package.module:Class             a class with fit(run, rows) and predict(run) -> maps [n, N, N],
                                     metres, NaN: no return
    ./mine                           a command, called as ./mine TRAIN TEST OUT; it writes
                                     OUT/maps.npy and OUT/records.csv"""
from __future__ import annotations

import argparse
import errno
import importlib
import os
import sqlite3
import sys
from collections.abc import Callable

import numpy as np

from .. import __version__, runs
from ..models.maps import load_maps
from ..runs.programs import EXIT_CODES, BenchError, UsageError
from . import letters, recipe, stability
from .methods import method
from .table import Table, fill, finish, of_runs, pareto_cells

def part_of(text: str) -> tuple[int, int]:
    """"3/8" as (3, 8). Raises argparse.ArgumentTypeError."""
    try:
        k, n = map(int, text.split("/"))
        if 1 <= k <= n:
            return k, n
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text}: expected K/N with K from 1 to N, as 3/8")


def wide(prog: str) -> argparse.HelpFormatter:
    return argparse.RawDescriptionHelpFormatter(prog, max_help_position=32)


def add_table_options(one: argparse.ArgumentParser) -> None:
    """Adds the options of the commands that write a table."""
    one.add_argument("--out", required=True, metavar="CSV",
                     help="table to write; rows that are there are not measured again")
    one.add_argument("--seeds", type=int,
                     help="trainings of each method (default: 3, or the recipe's)")
    one.add_argument("--jobs", type=int, default=1, help="cells at a time (default 1)")
    one.add_argument("--part", type=part_of, default=(1, 1), metavar="K/N",
                     help="only the K-th of N parts, as of a Slurm array")
    one.add_argument("--markdown", action="store_true", help="print the table for a README")
    one.add_argument("--figure", metavar="FILE",
                     help="draw it (python3-matplotlib): NAME.svg, NAME.pdf or NAME.png")
    one.add_argument("-q", "--quiet", action="store_true", help="no progress")


def parser_of() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = argparse.ArgumentParser(prog="echofuse-bench",
                                     description=__doc__,
                                     epilog="exit codes:  COMMAND --help lists them",
                                     formatter_class=wide)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", title="Subcommands")

    def command(name: str, text: str,
                run: Callable[[argparse.Namespace], Table]) -> argparse.ArgumentParser:
        one = commands.add_parser(name, help=text, description=text, formatter_class=wide,
                                  epilog=f"{EXIT_CODES}3 config, 6 disk, 130 interrupted")
        add_table_options(one)
        one.set_defaults(run=run)
        return one

    one = command("pareto", "accuracy against cost, photons and records", _pareto)
    one.add_argument("train", help="run to train on")
    one.add_argument("test", help="run to judge by")
    usual = ["empty", "mean", "nearest", "ridge", "mean-shape", "factorised-16", "mlp-512-256"]
    one.add_argument("--methods", nargs="+", metavar="METHOD", default=usual,
                     help=f"default: {' '.join(usual)}")
    one.add_argument("--sweep", nargs="*", metavar="METHOD", default=[],
                     help="methods with fewer photons and records")
    stability.add_command(command("stability", "where methods fail", stability.run))
    recipe.add_command(command("run", "the bench of a recipe (default: echofuse-bench-2)",
                               recipe.run))
    one = commands.add_parser("letters", help="share of the letters that can be read off maps",
                              description=letters.__doc__, formatter_class=wide,
                              epilog=f"{EXIT_CODES}130 interrupted")
    one.add_argument("maps", metavar="MAPS",
                     help="folder of maps.npy and records.csv, as `echofuse-recon reconstruct "
                          "--format npy` makes it")
    one.add_argument("of", metavar="RUN", help="run with labels as letter:A, and the truth")
    one.set_defaults(run=_letters)
    for one in (parser, *commands.choices.values()):
        one.add_argument("--version", action="version", version=f"echofuse-bench {__version__}",
                         help="print the version and exit")
    return parser


def main() -> None:
    """Runs the program echofuse-bench."""
    args = parser_of().parse_args()
    sys.path.append(os.getcwd())  # methods in the current folder
    try:
        if getattr(args, "figure", None):
            require_matplotlib()
        table = args.run(args)
        if table and table.failed:
            raise BenchError(f"{table.failed} rows of methods that failed; {table.log} has the "
                             "tracebacks")
    except (RuntimeError, ValueError, OSError, sqlite3.Error) as error:
        print(f"echofuse-bench: {error}", file=sys.stderr)
        full = getattr(error, "errno", 0) in (errno.ENOSPC, errno.EDQUOT,
                                              errno.EFBIG) or "disk" in str(error)
        sys.exit(getattr(error, "code", 6 if full else 1))
    except KeyboardInterrupt:
        sys.exit(130)


def require_matplotlib() -> None:
    """Raises UsageError before anything is measured for a figure that cannot be drawn."""
    try:
        importlib.import_module("matplotlib")
    except ImportError as error:
        raise UsageError(f"--figure: {error}; install python3-matplotlib") from None


def _pareto(args: argparse.Namespace) -> Table:
    if runs.open(args.train).info["uuid"] == runs.open(args.test).info["uuid"]:
        raise UsageError(f"{args.test}: the methods are trained on this run; judge them by another")
    methods, sweep = ([method(name) for name in names] for names in (args.methods, args.sweep))
    table = Table(args.out, of_runs(args.train, args.test), args.part)
    fill(table, pareto_cells(args.train, args.test, methods, seeds=args.seeds or 3, sweep=sweep),
         jobs=args.jobs, part=args.part, quiet=args.quiet)
    finish(table, args, lambda plot: plot.pareto(args.out))
    return table


def _letters(args: argparse.Namespace) -> None:
    maps, index = load_maps(args.maps)
    with runs.open(args.of) as run:
        row_of = {one: row for row, one in enumerate(run.index.tolist())}
        if missing := [one for one in index.tolist() if one not in row_of]:
            raise BenchError(
                f"{args.maps}: a map of record {missing[0]}, which {run.path} does not have")
        rows = [row_of[one] for one in index.tolist()]
        truth = run.maps()[rows]
        if truth.shape != maps.shape:
            raise BenchError(
                f"{args.maps}: maps of {maps.shape[1]} x {maps.shape[2]}; the run's are "
                f"{truth.shape[1]} x {truth.shape[2]}")
        axis = run.axes.get("map_x")
        found = letters.read(maps, truth, [run.labels[row] for row in rows],
                             axis.step * axis.count / 2 if axis else 0.55)
    if not np.isfinite(found[0]).any():
        raise BenchError(f"{args.of}: no record with depth is labelled letter:A or the like")
    print(letters.text(*found))
