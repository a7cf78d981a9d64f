# SPDX-License-Identifier: MIT
"""The table of a bench, and the cells that fill it (bench.py)."""
from __future__ import annotations

import argparse
import collections
import concurrent.futures
import csv
import pathlib
import shutil
import sqlite3
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import derive
from . import run as runs
from .methods import COSTS, METRICS, Method, Path, Row, UsageError, judge, version, writing
from .staged import sync

COLUMNS = ("axis", "value", "model", "inputs", "seed", *METRICS, *COSTS)


class Table:
    """Rows of a CSV file, by axis, value, model, inputs and seed. A row that is there is not
    measured again; each new one is on the disk before the next. `of`: what it is a table of, its
    first line; another one is refused (BenchError). A part (k, n) is a file beside it,
    NAME-part-k-of-n.csv; the whole takes the rows of all parts that are there. Files one behind the
    other (cat) are one, too."""

    def __init__(self, path: Path, of: str = "", part: tuple[int, int] = (1, 1)) -> None:
        whole = pathlib.Path(path)
        self.path = whole if part[1] == 1 else whole.with_name(
            f"{whole.stem}-part-{part[0]}-of-{part[1]}{whole.suffix}")
        self.of = of
        self.rows: dict[tuple[str, ...], Row] = {}
        here = self._read(self.path)
        if part[1] == 1:
            for other in sorted(whole.parent.glob(f"{whole.stem}-part-*-of-*{whole.suffix}")):
                for key, row in self._read(other).items():
                    if key not in here:
                        self.add(row)
        elif whole.exists():
            self.rows = self._read(whole)
        self.rows |= here

    def _read(self, path: pathlib.Path) -> dict[tuple[str, ...], Row]:
        if not path.exists():
            return {}
        data = path.read_bytes()
        whole = data[:data.rfind(b"\n") + 1]
        lines = whole.decode(errors="replace").splitlines()
        for line in lines:
            if self.of and line.startswith("# ") and line[2:] != self.of:
                raise UsageError(
                    f"{path}: is of {line[2:]}; expected {self.of}; name another --out")
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        if data and tuple(rows.fieldnames or ()) != COLUMNS:
            raise UsageError(f"{path}: is no table of a bench; name another --out")
        if path == self.path and whole != data:  # a killed process was writing
            with writing(path), open(path, "r+b") as file:
                file.truncate(len(whole))
        return {self.key(row): row for row in rows if row["axis"] != "axis"}

    @staticmethod
    def key(row: Row) -> tuple[str, ...]:
        return tuple(str(row[name]) for name in COLUMNS[:5])

    def add(self, row: Row, on_disk: bool = True) -> None:
        self.rows[self.key(row)] = row
        if not on_disk:
            return
        with writing(self.path):
            self._append(row)

    def _append(self, row: Row) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with open(self.path, "a", newline="") as file:
            out = csv.DictWriter(file, COLUMNS, restval="nan", lineterminator="\n")
            if new := file.tell() == 0:
                file.write(f"# {self.of}\n" if self.of else "")
                out.writeheader()
            out.writerow({name: f"{value:.9g}" if isinstance(value, float) else value
                          for name, value in row.items()})
        sync(self.path)
        if new:
            sync(self.path.parent)


def of_runs(train: Path, test: Path) -> str:
    """Source line of a table of these runs: version and uuids."""
    return f"{version()}: runs " + " ".join(str(runs.open(path).info["uuid"])
                                            for path in (train, test))


@dataclass(frozen=True)
class Source:
    """A run to come: make(folder) writes it there, and returns its path. Equal keys are the same
    run."""

    key: str
    make: Callable[[pathlib.Path], pathlib.Path]


def there(path: Path) -> Source:
    """A run that is there."""
    found = pathlib.Path(path).resolve()
    return Source(str(found), lambda folder: found)


@dataclass(frozen=True)
class Cell:
    """One row to come."""

    axis: str
    value: str
    how: Method
    seed: int
    train: Source
    test: Source
    fallback: bool = False

    @property
    def head(self) -> Row:
        return {"axis": self.axis, "value": self.value, "model": self.how.model,
                "inputs": self.how.inputs, "seed": self.seed}

    @property
    def fitted(self) -> str:
        """Key of what it needs fitted."""
        return f"{self.how.name} {self.seed} {self.fallback} {self.train.key}"


class Shared:
    """Runs and fitted methods of the cells: made at the first use, removed after the last one."""

    def __init__(self, cells: Sequence[Cell], folder: pathlib.Path) -> None:
        self.folder, self.lock = folder, threading.Lock()
        self.left = collections.Counter(key for cell in cells
                                        for key in (cell.train.key, cell.test.key, cell.fitted))
        self.made: dict[str, tuple[pathlib.Path, concurrent.futures.Future[Any]]] = {}

    def get(self, key: str, make: Callable[[pathlib.Path], Any]) -> Any:
        with self.lock:
            first = key not in self.made
            if first:
                self.made[key] = pathlib.Path(
                    tempfile.mkdtemp(dir=self.folder)), concurrent.futures.Future()
            folder, made = self.made[key]
        if first:
            try:
                made.set_result(make(folder))
            except Exception as error:  # noqa: BLE001 (of all that wait for it)
                made.set_exception(error)
        return made.result()

    def row(self, cell: Cell) -> Row:
        try:
            train = self.get(cell.train.key, cell.train.make)
            answer = self.get(cell.fitted,
                              lambda folder: cell.how.fit(train, folder, cell.seed, cell.fallback))
            return judge(answer, train, self.get(cell.test.key, cell.test.make))
        finally:
            with self.lock:
                for key in (cell.train.key, cell.test.key, cell.fitted):
                    self.left[key] -= 1
                    if self.left[key] == 0 and key in self.made:
                        shutil.rmtree(self.made.pop(key)[0])


def fill(table: Table, cells: Sequence[Cell], *, jobs: int = 1, part: tuple[int, int] = (1, 1),
         quiet: bool = False) -> None:
    """Measures what the table lacks, or this part of it. Cells with the same fitted method are in
    one part. A candidate that fails at a value has a row of NaN; a method of one's own is tried
    again next time. Reasons are said once. Raises OSError, sqlite3.Error: a missing file and a full
    disk say nothing of a method."""
    pieces = {key: k for k, key in enumerate(dict.fromkeys(cell.fitted for cell in cells))}
    mine = [cell for cell in cells if pieces[cell.fitted] % part[1] == part[0] - 1
            and Table.key(cell.head) not in table.rows]
    said: set[str] = set()

    def one(cell: Cell) -> tuple[Row, str]:
        try:
            return cell.head | shared.row(cell), ""
        except (UsageError, OSError, sqlite3.Error):  # no fault of the method
            raise
        except Exception as error:  # noqa: BLE001 (a method of anybody's)
            return cell.head | dict.fromkeys(METRICS + COSTS,
                                             float("nan")), str(error) or type(error).__name__

    with (tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch,
          concurrent.futures.ThreadPoolExecutor(jobs) as pool):
        shared = Shared(mine, pathlib.Path(scratch))
        started = time.monotonic()
        for done, (row, fault) in enumerate(pool.map(one, mine), 1):
            table.add(row, on_disk=not (fault and row["inputs"] == "-"))
            if fault and fault not in said:
                said.add(fault)
                print(f"echofuse-bench: {row['model']}: {fault}", file=sys.stderr)
            if not quiet:
                left_s = (time.monotonic() - started) / done * (len(mine) - done)
                print(f"\rbench {done} of {len(mine)}, {left_s:.0f} s left   ",
                      end="" if sys.stderr.isatty() else "\n",
                      file=sys.stderr, flush=True)


def pareto_cells(train: Path, test: Path, methods: Iterable[Method], *, seeds: int = 3,
                 photons: Sequence[float] = (0.1, 0.01, 0.001),
                 records: Sequence[float] = (0.05, 0.2, 0.5), sweep: Iterable[Method] = (),
                 axis: str = "model") -> list[Cell]:
    """Every method with every seed; then those of `sweep` with shares of the photons and of the
    training records."""
    known, fresh = there(train), there(test)
    cells = [Cell(axis, "1", how, seed, known, fresh) for how in methods
             for seed in range(1, seeds + 1)]

    def derived(source: Source, what: str, *changes: derive.Change) -> Source:
        return Source(f"{source.key} {what}",
                      lambda folder: derive.copy(source.make(folder), folder / "run.sqlite",
                                                 *changes))

    for how in sweep:
        for seed in range(1, seeds + 1):
            cells += [Cell("photons", f"{share:g}", how, seed,
                           derived(known, f"thinned {share} {seed}", derive.thinned(share, seed)),
                           derived(fresh, f"thinned {share} {seed}",
                                   derive.thinned(share, 1000 + seed))) for share in photons]
            cells += [Cell("records", f"{share:g}", how, seed,
                           derived(known, f"fewer {share} {seed}", derive.fewer(share, seed)),
                           fresh) for share in records]
    return cells


# Words and pictures


def means(table: Table, axis: str = "model") -> list[Row]:
    """Mean and spread (standard deviation over the seeds) of each metric and cost, a row a method
    and value."""
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
    head = ("inputs", "method", "IoU", "depth error", "SSIM on the foreground", "lateral error",
            "mirror fraction", "multiply-adds", "time of a map")
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    order = {"-": 0, "fused": 1, "fused-profile": 2, "spd": 3, "radar": 4}

    def number(row: Row, name: str, digits: int, unit: float = 1, behind: str = "") -> str:
        mean, spread = unit * row[name], unit * row[name + "_spread"]
        if np.isnan(mean):
            return ""
        return f"{mean:.{digits}f}" + ("" if np.isnan(spread)
                                       else f" ± {spread:.{digits}f}") + behind

    for row in sorted(rows, key=lambda row: order.get(row["inputs"], 9)):
        cost = ("" if np.isnan(row["multiply_adds"])
                else f"{row['multiply_adds']:,.0f}".replace(",", " "))
        inputs = row["inputs"] + (f", {row['value']}" if row["value"] != "1" else "")
        lines.append("| " + " | ".join((inputs, f"`{row['model']}`", number(row, "iou", 3),
                                        number(row, "depth_mae_m", 1, 100, " cm"),
                                        number(row, "ssim_fg", 3),
                                        number(row, "lateral_m", 1, 100, " cm"),
                                        number(row, "ghost", 3), cost,
                                        number(row | {"infer_us_median_spread": float("nan")},
                                               "infer_us_median", 0, 1, " µs")))
                     + " |")
    return "\n".join(lines)


def finish(table: Table, args: argparse.Namespace, draw: Callable[[Any], Any],
           axis: str = "model") -> None:
    """Ends each command: prints the table for a README, draws the figure."""
    if args.markdown:
        print(markdown(means(table, axis)))
    if args.figure:
        from . import plot

        figure = draw(plot)
        with writing(args.figure):
            figure.savefig(args.figure)
