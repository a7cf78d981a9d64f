# SPDX-License-Identifier: MIT
"""Compares methods that predict depth maps. `pareto` measures how their accuracy depends on cost,
`stability` finds the conditions under which each method fails, and `run` runs the three-track
benchmark.

A METHOD is one of::

    factorised-16, mlp-512-256:spd   a kind of model that `echofuse-recon train --model` accepts,
                                     optionally followed by a colon and its inputs
    package.module:Class             a Python class with fit(run, rows) and predict(run); predict
                                     returns maps [n, N, N] in metres, with NaN for no return
    ./mine                           a program; it is started as ./mine TRAIN TEST OUT and must
                                     write OUT/maps.npy and OUT/records.csv"""
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
from ..runs.programs import EXIT_CODES, ProgramError, UsageError, positive
from . import letters, recipe, stability
from .methods import method
from .table import Table, fill, finish, pareto_cells, source_line

__all__ = ["main"]


def parse_part(text: str) -> tuple[int, int]:
    """Parses "3/8" into (3, 8). Raises argparse.ArgumentTypeError for any other string."""
    try:
        k, n = map(int, text.split("/"))
        if 1 <= k <= n:
            return k, n
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text}: expected K/N with K from 1 to N, e.g. 3/8")


def wide_formatter(prog: str) -> argparse.HelpFormatter:
    return argparse.RawDescriptionHelpFormatter(prog, max_help_position=32)


def add_table_options(command: argparse.ArgumentParser) -> None:
    """Adds the options shared by all commands that write a result table."""
    command.add_argument("--out", required=True, metavar="CSV",
                         help="CSV table to write; rows that it already contains are not measured "
                              "again")
    command.add_argument("--seeds", type=positive,
                         help="number of training runs per method, each with its own seed "
                              "(default: 3, or the number in the recipe)")
    command.add_argument("--jobs", type=positive, default=1,
                         help="number of table rows that are measured in parallel (default: 1)")
    command.add_argument("--part", type=parse_part, default=(1, 1), metavar="K/N",
                         help="measure only part K of N parts of the table, e.g. 3/8 in a Slurm "
                              "array")
    command.add_argument("--markdown", action="store_true", help="print the table as Markdown")
    command.add_argument("--figure", metavar="FILE",
                         help="draw a chart of the table as NAME.svg, NAME.pdf or NAME.png (needs "
                              "python3-matplotlib)")
    command.add_argument("-q", "--quiet", action="store_true", help="do not print the progress")


def make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="echofuse-bench", description=__doc__,
                                     epilog="exit codes:  COMMAND --help lists them",
                                     formatter_class=wide_formatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", title="Subcommands")

    def add_command(name: str, text: str,
                    run: Callable[[argparse.Namespace], Table]) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text,
                                      formatter_class=wide_formatter,
                                      epilog=f"{EXIT_CODES}3 config, 6 disk, 130 interrupted")
        add_table_options(command)
        command.set_defaults(run=run)
        return command

    command = add_command("pareto", "measure how the accuracy of methods depends on cost, photons "
                                    "and training records", _pareto)
    command.add_argument("train", help="run on which the methods are trained")
    command.add_argument("test", help="run on which the methods are tested")
    default = ["empty", "mean", "nearest", "ridge", "mean-shape", "factorised-16", "mlp-512-256"]
    command.add_argument("--methods", nargs="+", metavar="METHOD", default=default,
                         help="methods to compare, separated by blanks (default: "
                              f"{' '.join(default)})")
    command.add_argument("--sweep", nargs="*", metavar="METHOD", default=[],
                         help="methods that are also measured with fewer photons and with fewer "
                              "training records")
    stability.add_command(add_command("stability", "find the conditions under which methods fail",
                                      stability.run))
    recipe.add_command(add_command("run", "run the benchmark that a recipe file "
                                          "describes", recipe.run))
    command = commands.add_parser("letters",
                                  help="measure the fraction of readable letters in depth maps",
                                  description=letters.__doc__, formatter_class=wide_formatter,
                                  epilog=f"{EXIT_CODES}130 interrupted")
    command.add_argument("maps", metavar="MAPS",
                         help="folder with maps.npy and records.csv, written by `echofuse-recon "
                              "reconstruct --format npy`")
    command.add_argument("truth", metavar="RUN",
                         help="run with the ground-truth maps and with labels such as letter:A")
    command.set_defaults(run=_letters)
    for command in (parser, *commands.choices.values()):
        command.add_argument("--version", action="version", version=f"echofuse-bench {__version__}",
                             help="print the version and exit")
    return parser


def main() -> None:
    """Runs echofuse-bench with the arguments in sys.argv."""
    args = make_parser().parse_args()
    sys.path.append(os.getcwd())  # allows methods to be imported from the current folder
    try:
        if getattr(args, "figure", None):
            require_matplotlib()
        table = args.run(args)
        if table and (failed := table.failed or table.unmeasured):
            raise ProgramError(f"{failed} table rows failed; the tracebacks are in {table.log}")
    except (RuntimeError, ValueError, OSError, sqlite3.Error) as error:
        print(f"echofuse-bench: {error}", file=sys.stderr)
        full = getattr(error, "errno", 0) in (errno.ENOSPC, errno.EDQUOT,
                                              errno.EFBIG) or "disk" in str(error)
        sys.exit(getattr(error, "code", 6 if full else 1))
    except KeyboardInterrupt:
        sys.exit(130)


def require_matplotlib() -> None:
    """Raises UsageError if matplotlib is missing, before any measurement starts."""
    try:
        importlib.import_module("matplotlib")
    except ImportError as error:
        raise UsageError(f"--figure: {error}; install python3-matplotlib") from None


def _pareto(args: argparse.Namespace) -> Table:
    if runs.open(args.train).info["uuid"] == runs.open(args.test).info["uuid"]:
        raise UsageError(f"{args.test}: is a training run; score another run")
    methods, sweep = ([method(name) for name in names] for names in (args.methods, args.sweep))
    table = Table(args.out, source_line(args.train, args.test), args.part)
    fill(table, pareto_cells(args.train, args.test, methods, seeds=args.seeds or 3, sweep=sweep),
         jobs=args.jobs, part=args.part, quiet=args.quiet)
    finish(table, args, lambda plot: plot.pareto(args.out))
    return table


def _letters(args: argparse.Namespace) -> None:
    maps, index = load_maps(args.maps)
    with runs.open(args.truth) as run:
        row_of = {number: row for row, number in enumerate(run.index.tolist())}
        if missing := [number for number in index.tolist() if number not in row_of]:
            raise ProgramError(f"{args.maps}: record {missing[0]} has a map, but it is not in "
                               f"{run.path}")
        rows = [row_of[number] for number in index.tolist()]
        truth = run.maps()[rows]
        if truth.shape != maps.shape:
            raise ProgramError(
                f"{args.maps}: the maps have {maps.shape[1]} x {maps.shape[2]} pixels; expected "
                f"{truth.shape[1]} x {truth.shape[2]} pixels as in the run")
        found = letters.read(maps, truth, [run.labels[row] for row in rows], run.half_tangent)
    if not np.isfinite(found[0]).any():
        raise ProgramError(f"{args.truth}: no record with a depth map has a label such as letter:A")
    print(letters.text(*found))
