# SPDX-License-Identifier: MIT
"""echofuse-bench: methods beside one another. Accuracy against cost (pareto), where each fails (stability), and the
bench of three tracks that anybody can make again (run).

A method is
    factorised-16, mlp-512-256:spd   a candidate of `echofuse-recon train`, perhaps with its inputs
    package.module:Class             a class with fit(run, rows) and predict(run) -> maps [n, N, N], metres, NaN: no return
    ./mine                           a command, called as ./mine TRAIN TEST OUT; it writes OUT/maps.npy and OUT/records.csv

>>> from echofuse import bench
>>> bench.measure(bench.method("nearest"), "train.sqlite", "test.sqlite")["iou"]
"""
from __future__ import annotations

import argparse
import concurrent.futures
import csv
import importlib
import json
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from . import derive
from . import run as runs
from .maps import save_maps

METRICS = ("iou", "ssim", "ssim_hard", "ssim_fg", "rmse_m", "rmse_fg_m", "depth_mae_m", "abs_rel", "delta_125", "lateral_m",
           "ghost", "left_right", "iou_person")
COSTS = ("multiply_adds", "infer_us_median", "infer_us_p99", "train_s")
COLUMNS = ("axis", "value", "model", "inputs", "seed", *METRICS, *COSTS)
Path = str | pathlib.Path
Row = dict[str, Any]


class BenchError(RuntimeError):
    """What a program or a method said when it failed, in one line."""


def call(program: str, *words: object) -> str:
    """Standard output of one of the programs ($ECHOFUSE_BIN names their folder). Raises BenchError with its last line."""
    folder = os.environ.get("ECHOFUSE_BIN")
    command = [os.path.join(folder, program) if folder else program, *map(str, words)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise BenchError(f"{command[0]}: not found; put the programs into PATH, or set ECHOFUSE_BIN") from None
    if done.returncode:
        raise BenchError((done.stderr.strip().splitlines() or [f"{program}: exit code {done.returncode}"])[-1])
    return done.stdout


class Fitted(Protocol):
    """The interface of a method in Python. `rows` are indices into the run's records to learn from."""

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None: ...

    def predict(self, run: runs.Run) -> NDArray[np.float32]: ...


@dataclass(frozen=True)
class Method:
    """A name, and how to come from two runs to a judged thing: the words that `evaluate` takes, and costs."""

    model: str
    inputs: str
    prepare: Callable[[pathlib.Path, pathlib.Path, pathlib.Path, int], tuple[list[str], Row]]

    @property
    def name(self) -> str:
        return self.model if self.inputs in ("fused", "-") else f"{self.model}:{self.inputs}"


def method(text: str) -> Method:
    """The method of this name (see above). Raises BenchError for a class that is not there."""
    if "/" in text:
        return Method(text, "-", lambda train, test, folder, seed: _by_command(text, train, test, folder, seed))
    module, _, name = text.partition(":")
    if "." in module or importlib.util.find_spec(module) is not None and name[:1].isupper():
        try:
            made = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError) as error:
            raise BenchError(f"method {text}: {error}") from None
        return python_method(text, made)
    return Method(module, name or "fused", lambda train, test, folder, seed: _by_candidate(module, name or "fused", train, folder, seed))


def python_method(name: str, make: Callable[..., Fitted]) -> Method:
    """A method of this name: make() or make(seed=...) gives an object with fit and predict."""
    return Method(name, "-", lambda train, test, folder, seed: _by_object(make, train, test, folder, seed))


def _by_candidate(model: str, inputs: str, train: pathlib.Path, folder: pathlib.Path, seed: int) -> tuple[list[str], Row]:
    out = folder / "model.safetensors"
    words = ["--inputs", inputs] if inputs != "fused" else []
    call("echofuse-recon", "-q", "train", train, "--model", model, *words, "--seed", seed, "--set", "test_share=0", "--out", out)
    return [str(out)], {}


def _by_object(make: Callable[..., Fitted], train: pathlib.Path, test: pathlib.Path, folder: pathlib.Path,
               seed: int) -> tuple[list[str], Row]:
    try:
        one = make(seed=seed)
    except TypeError:
        one = make()
    with runs.open(train) as known, runs.open(test) as fresh:
        started = time.perf_counter()
        one.fit(known, np.flatnonzero(known.valid["depth"]))
        trained = time.perf_counter()
        maps = np.asarray(one.predict(fresh), np.float32)
        us = 1e6 * (time.perf_counter() - trained) / max(len(fresh), 1)
        if maps.ndim != 3 or len(maps) != len(fresh) or maps.shape[1] != maps.shape[2]:
            raise BenchError(f"{type(one).__name__}.predict gave {maps.shape}; expected [{len(fresh)}, N, N]")
        save_maps(folder / "maps", maps, fresh.index)
    return ["--maps", str(folder / "maps")], {"train_s": trained - started, "infer_us_median": us}


def _by_command(text: str, train: pathlib.Path, test: pathlib.Path, folder: pathlib.Path, seed: int) -> tuple[list[str], Row]:
    started = time.perf_counter()
    environment = os.environ | {"ECHOFUSE_SEED": str(seed)}
    done = subprocess.run([*shlex.split(text), train, test, folder / "maps"], capture_output=True, text=True, env=environment,
                          check=False)
    if done.returncode:
        raise BenchError(f"{text}: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")
    return ["--maps", str(folder / "maps")], {"train_s": time.perf_counter() - started}


def measure(how: Method, train: Path, test: Path, seed: int = 1) -> Row:
    """Metrics (means over the records) and costs of the method, trained on one run and judged on another. Multiply-adds
    and times of a map are the program's own for its candidates; of others a record's share of the whole prediction."""
    with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
        folder = pathlib.Path(scratch)
        words, costs = how.prepare(pathlib.Path(train).resolve(), pathlib.Path(test).resolve(), folder, seed)
        told = json.loads(call("echofuse-recon", "-q", "evaluate", *words, test, "--train", train, "--json"))
    row: Row = {name: nan_if_none(told["metrics"].get(name, {}).get("mean")) for name in METRICS}
    return row | {name: nan_if_none((told.get("cost") or {}).get(name, costs.get(name))) for name in COSTS}


def nan_if_none(value: float | None) -> float:
    return float("nan") if value is None else float(value)


# The table


class Table:
    """Rows of a CSV file, by axis, value, model, inputs and seed. A row that is there is not measured again; each new
    one is on the disk before the next. Files of parts (Slurm arrays) are concatenated: their heads are passed over."""

    def __init__(self, path: Path) -> None:
        self.path = pathlib.Path(path)
        self.rows: dict[tuple[str, ...], Row] = {}
        if self.path.exists():
            text = self.path.read_text()
            whole = text[:text.rfind("\n") + 1]
            if whole != text:  # a killed process was writing
                self.path.write_text(whole)
            for row in csv.DictReader(whole.splitlines()):
                if row["axis"] != "axis":
                    self.rows[self.key(row)] = row | {name: str(row[name]) for name in COLUMNS[:5]}

    def require_of(self, train: Path, test: Path) -> None:
        """Notes beside the table which runs it is of. Raises BenchError if it is of others."""
        now = " ".join(str(runs.open(path).info["uuid"]) for path in (train, test))
        note = self.path.with_name(self.path.name + ".runs")
        before = note.read_text().strip() if note.exists() else now
        if before != now:
            raise BenchError(f"{self.path}: is of other runs ({note}); name another --out")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        note.write_text(now + "\n")

    @staticmethod
    def key(row: Row) -> tuple[str, ...]:
        return tuple(str(row[name]) for name in COLUMNS[:5])

    def add(self, row: Row) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with open(self.path, "a", newline="") as file:
            out = csv.DictWriter(file, COLUMNS, restval="nan", lineterminator="\n")
            if file.tell() == 0:
                out.writeheader()
            out.writerow({name: f"{value:.6g}" if isinstance(value, float) else value for name, value in row.items()})
        self.rows[self.key(row)] = row


@dataclass(frozen=True)
class Cell:
    """One row to come: `train` and `test` make the runs, in a folder that is removed afterwards."""

    axis: str
    value: str
    how: Method
    seed: int
    train: Callable[[pathlib.Path], pathlib.Path]
    test: Callable[[pathlib.Path], pathlib.Path]

    @property
    def head(self) -> Row:
        return {"axis": self.axis, "value": self.value, "model": self.how.model, "inputs": self.how.inputs, "seed": self.seed}


def fill(table: Table, cells: Sequence[Cell], *, jobs: int = 1, part: tuple[int, int] = (1, 1), quiet: bool = False) -> None:
    """Measures what the table lacks. A method that fails at a value has a row of NaN, and its reason is said once."""
    mine = [cell for k, cell in enumerate(cells) if k % part[1] == part[0] - 1 and Table.key(cell.head) not in table.rows]
    said: set[str] = set()

    def one(cell: Cell) -> tuple[Row, str]:
        with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
            folder = pathlib.Path(scratch)
            try:
                return cell.head | measure(cell.how, cell.train(folder), cell.test(folder), cell.seed), ""
            except Exception as error:  # noqa: BLE001 (a method of anybody's)
                reason = str(error) or type(error).__name__
                return cell.head | dict.fromkeys(METRICS + COSTS, float("nan")), reason

    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        started = time.monotonic()
        for done, (row, fault) in enumerate(pool.map(one, mine), 1):
            table.add(row)
            if fault and fault not in said:
                said.add(fault)
                print(f"echofuse-bench: {row['model']}: {fault}", file=sys.stderr)
            if not quiet:
                left_s = (time.monotonic() - started) / done * (len(mine) - done)
                print(f"\rbench {done} of {len(mine)}, {left_s:.0f} s left   ", end="" if sys.stderr.isatty() else "\n",
                      file=sys.stderr, flush=True)


def pareto_cells(train: Path, test: Path, methods: Iterable[Method], *, seeds: int = 3, photons: Sequence[float] = (),
                 records: Sequence[float] = (), sweep: Iterable[Method] = ()) -> list[Cell]:
    """Every method with every seed; then those of `sweep` with shares of the photons and of the training records."""
    train, test = pathlib.Path(train), pathlib.Path(test)
    cells = [Cell("model", "1", how, seed, lambda folder: train, lambda folder: test)
             for how in methods for seed in range(1, seeds + 1)]

    def thinned(path: pathlib.Path, name: str, share: float, seed: int) -> Callable[[pathlib.Path], pathlib.Path]:
        return lambda folder: derive.copy(path, folder / name, derive.thinned(share, seed))

    def fewer(share: float, seed: int) -> Callable[[pathlib.Path], pathlib.Path]:
        return lambda folder: derive.copy(train, folder / "train.sqlite", derive.fewer(share, seed))

    for how in sweep:
        for seed in range(1, seeds + 1):
            cells += [Cell("photons", f"{share:g}", how, seed, thinned(train, "train.sqlite", share, seed),
                           thinned(test, "test.sqlite", share, 1000 + seed)) for share in photons]
            cells += [Cell("records", f"{share:g}", how, seed, fewer(share, seed), lambda folder: test) for share in records]
    return cells


# Words and pictures


def means(table: Table, axis: str = "model") -> list[Row]:
    """Mean and spread (standard deviation over the seeds) of each metric and cost, a row a method and value."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for key, row in table.rows.items():
        if row["axis"] == axis:
            groups.setdefault(key[1:4], []).append(row)
    out = []
    for (value, model, inputs), rows in groups.items():
        one: Row = {"value": value, "model": model, "inputs": inputs, "seeds": len(rows)}
        for name in METRICS + COSTS:
            values = np.array([float(row[name]) for row in rows])
            one[name] = float(values.mean())
            one[name + "_spread"] = float(values.std(ddof=1)) if len(values) > 1 else float("nan")
        out.append(one)
    return out


def markdown(rows: Sequence[Row]) -> str:
    """A table for a README: rows of equal inputs together."""
    head = ("inputs", "method", "IoU", "SSIM on the foreground", "lateral error", "ghost", "multiply-adds", "time of a map")
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    order = {"-": 0, "fused": 1, "fused-profile": 2, "spd": 3, "radar": 4}

    def number(row: Row, name: str, digits: int, unit: float = 1, behind: str = "") -> str:
        mean, spread = unit * row[name], unit * row[name + "_spread"]
        if np.isnan(mean):
            return ""
        return f"{mean:.{digits}f}" + ("" if np.isnan(spread) else f" ± {spread:.{digits}f}") + behind

    for row in sorted(rows, key=lambda row: order.get(row["inputs"], 9)):
        cost = "" if np.isnan(row["multiply_adds"]) else f"{row['multiply_adds']:,.0f}".replace(",", " ")
        lines.append("| " + " | ".join((row["inputs"], f"`{row['model']}`", number(row, "iou", 3), number(row, "ssim_fg", 3),
                                        number(row, "lateral_m", 1, 100, " cm"), number(row, "ghost", 3), cost,
                                        number(row | {"infer_us_median_spread": float("nan")}, "infer_us_median", 0, 1, " µs")))
                     + " |")
    return "\n".join(lines)


def part_of(text: str) -> tuple[int, int]:
    """"3/8" as (3, 8). Raises argparse.ArgumentTypeError."""
    try:
        k, n = map(int, text.split("/"))
        if 1 <= k <= n:
            return k, n
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text}: expected K/N with K from 1 to N, as 3/8")


def main() -> None:
    from . import recipe, stability

    parser = argparse.ArgumentParser(prog="echofuse-bench", description=__doc__.split("\n\n")[0],
                                     epilog=__doc__.split("\n\n")[1], formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, text: str, run: Callable[[argparse.Namespace], None]) -> argparse.ArgumentParser:
        one = commands.add_parser(name, help=text, description=text)
        one.add_argument("--out", required=True, metavar="CSV", help="table to write; rows that are there are not measured again")
        one.add_argument("--seeds", type=int, help="trainings of each method (default: 3, or the recipe's)")
        one.add_argument("--jobs", type=int, default=1, help="cells at a time (default 1)")
        one.add_argument("--part", type=part_of, default=(1, 1), metavar="K/N", help="only the K-th of N parts, as of a Slurm array")
        one.add_argument("--markdown", action="store_true", help="print the table for a README")
        one.add_argument("--figure", metavar="FILE", help="draw it (python3-matplotlib): NAME.svg, NAME.pdf or NAME.png")
        one.add_argument("-q", "--quiet", action="store_true", help="no progress")
        one.set_defaults(run=run)
        return one

    one = command("pareto", "accuracy against cost, photons and records", _pareto)
    one.add_argument("train", help="run to train on")
    one.add_argument("test", help="run to judge by")
    one.add_argument("--methods", nargs="+", type=method, metavar="METHOD",
                     default=[method(m) for m in ("empty", "mean", "nearest", "ridge", "silhouette", "factorised-16", "mlp-512-256")])
    one.add_argument("--sweep", nargs="*", type=method, metavar="METHOD", default=[], help="methods with fewer photons and records")
    one.add_argument("--photons", nargs="*", type=float, default=[0.1, 0.01, 0.001], help="shares of the photons")
    one.add_argument("--records", nargs="*", type=float, default=[0.05, 0.2, 0.5], help="shares of the training records")
    stability.add_command(command("stability", "where methods fail", stability.run))
    recipe.add_command(command("run", "the bench of a recipe (default: echofuse-bench-1)", recipe.run))
    args = parser.parse_args()
    try:
        args.run(args)
    except (RuntimeError, ValueError, OSError) as error:
        sys.exit(f"echofuse-bench: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


def _pareto(args: argparse.Namespace) -> None:
    table = Table(args.out)
    table.require_of(args.train, args.test)
    fill(table, pareto_cells(args.train, args.test, args.methods, seeds=args.seeds or 3, photons=args.photons if args.sweep else (),
                             records=args.records if args.sweep else (), sweep=args.sweep),
         jobs=args.jobs, part=args.part, quiet=args.quiet)
    finish(table, args, lambda plot: plot.pareto(args.out))


def finish(table: Table, args: argparse.Namespace, draw: Callable[[Any], Any], axis: str = "model") -> None:
    """What all commands end with: a table for a README, a figure."""
    if args.markdown:
        print(markdown(means(table, axis)))
    if args.figure:
        from . import plot

        draw(plot).savefig(args.figure)


if __name__ == "__main__":
    main()
