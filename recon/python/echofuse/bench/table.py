# SPDX-License-Identifier: MIT
"""Measures results, and stores them as rows of a CSV table."""
from __future__ import annotations

import argparse
import collections
import concurrent.futures
import contextlib
import csv
import hashlib
import json
import os
import pathlib
import shutil
import sqlite3
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import runs
from ..runs.programs import ProgramError, UsageError, call
from ..runs.staged import locked, sync
from . import derive
from .methods import (COSTS, COUNTS, METRICS, RECORDED, Method, Path, Row, evaluate, version,
                      writing)

__all__ = ["Cell", "RunSource", "Table", "checksum", "content_hash", "existing_run", "fill",
           "finish", "markdown", "means", "pareto_cells", "source_line"]

HEAD = ("axis", "value", "model", "inputs", "seed", "source")
COLUMNS = (*HEAD, *METRICS, *COSTS, *COUNTS, "files")
COLUMNS_OF_RECORDS = (*HEAD, "record", *RECORDED)


class Table:
    """Result rows in a CSV file. Axis, value, model, inputs and seed form the key of a row. If
    several rows have the same key, the last one counts. The column `files` contains the hash of
    each file of the method's code, and `source` the hash of this column. An existing row is
    measured again only if one of these files has changed. Each new row is synced to disk before the
    next one is measured. A concatenation of tables (cat) is a valid table.

    `source` is the first line, which identifies the data. A file with a different first line is
    rejected (UsageError). The rows of part (k, n) are in NAME-part-k-of-n.csv; the whole table
    includes the rows of all existing parts. NAME.records.csv contains the scores of each record.
    `failed` is the number of failed rows of user methods; NAME.log contains their tracebacks."""

    def __init__(self, path: Path, source: str = "", part: tuple[int, int] = (1, 1)) -> None:
        whole = pathlib.Path(path)
        self.path = whole if part[1] == 1 else whole.with_name(
            f"{whole.stem}-part-{part[0]}-of-{part[1]}{whole.suffix}")
        self.source, self.log, self.failed = source, self.path.with_suffix(".log"), 0
        self.records = self.path.with_suffix(".records.csv")
        self.rows: dict[tuple[str, ...], Row] = {}
        here = self._read(self.path)
        if part[1] == 1:
            for other in sorted(whole.parent.glob(f"{whole.stem}-part-*-of-*{whole.suffix}")):
                if other.name.endswith(".records.csv"):
                    continue
                scores = read_scores(other.with_suffix(".records.csv"))
                newer = self.path.exists() and (other.stat().st_mtime_ns
                                                > self.path.stat().st_mtime_ns)
                for key, row in self._read(other).items():
                    known = here.get(key)
                    if known is None or newer and known["source"] != row["source"]:
                        here[key] = row
                        self.add(row, scores.get((*key, row["source"]), ()))
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
            if self.source and line.startswith("# ") and line[2:] != self.source:
                raise UsageError(f"{path}: contains results of {line[2:]} (expected "
                                 f"{self.source}); choose another --out")
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        if data and tuple(rows.fieldnames or ()) != COLUMNS:
            raise UsageError(f"{path}: not a bench table; choose another --out")
        if path == self.path and whole != data:  # removes an incomplete last line
            with writing(path), open(path, "r+b") as file:
                file.truncate(len(whole))
        return {self.key(row): row for row in rows if row["axis"] != "axis"}

    @staticmethod
    def key(row: Row) -> tuple[str, ...]:
        """Returns the key of a row: axis, value, model, inputs, seed."""
        return tuple(str(row[name]) for name in COLUMNS[:5])

    @property
    def unmeasured(self) -> int:
        """Number of rows if all rows contain NaN, otherwise 0."""
        return len(self.rows) * all(np.isnan(float(row["iou"])) for row in self.rows.values())

    def has(self, cell: Cell) -> bool:
        """Returns whether the table contains a valid row for this cell. The row of a failed user
        method, or of one with unknown code, is not valid."""
        row = self.rows.get(self.key(cell.head))
        if row is None or not cell.method.is_user_method:
            return row is not None
        stored = json.loads(row["files"] or "{}")
        return bool(stored and not np.isnan(float(row["iou"]))
                    and stored == cell.method.files(stored))

    def add(self, row: Row, records: Sequence[Row] = ()) -> None:
        """Appends a row and the scores of its records. The row replaces any existing row with the
        same key."""
        previous = self.rows.get(self.key(row), {"source": ""})
        self.rows[self.key(row)] = row
        if previous["source"] == row["source"] and np.isnan(float(row["iou"])):
            return  # the file already has a row for this failure
        head = {name: row[name] for name in HEAD}
        with writing(self.path):  # writes the scores before the row, so that no row lacks scores
            if records:
                self._append(self.records, COLUMNS_OF_RECORDS, [head | score for score in records])
            self._append(self.path, COLUMNS, [row])

    @contextlib.contextmanager
    def exclusive(self) -> Iterator[None]:
        """Locks the table for writing, and reads the rows added by other processes. Raises
        ProgramError if another process holds the lock."""
        lock = self.path.with_name(f".{self.path.name}.lock")
        with writing(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            try:
                descriptor = locked(lock)
            except BlockingIOError:
                raise ProgramError(f"{self.path}: the table is in use by another process; wait "
                                   "until that process ends, or split the work with --part K/N"
                                   ) from None
        try:
            self.rows |= self._read(self.path)
            yield
        finally:
            lock.unlink()
            os.close(descriptor)

    def log_failure(self, row: Row, error: BaseException) -> None:
        """Appends the traceback of a failed method to the log."""
        with writing(self.log), open(self.log, "a", encoding="utf-8") as file:
            file.write(" ".join(self.key(row)) + "\n"
                       + "".join(traceback.format_exception(error)) + "\n")

    def _append(self, path: pathlib.Path, columns: Sequence[str], rows: Iterable[Row]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        truncated = ends_without_newline(path)  # a killed process may have left an incomplete line
        with open(path, "a", newline="") as file:
            file.write("\n" * truncated)
            out = csv.DictWriter(file, columns, restval="nan", lineterminator="\n")
            if new := file.tell() == 0:
                file.write(f"# {self.source}\n" if self.source else "")
                out.writeheader()
            out.writerows({name: f"{value:.9g}" if isinstance(value, float) else value
                           for name, value in row.items()} for row in rows)
        sync(path)
        if new:
            sync(path.parent)


Key = tuple[str, ...]


def ends_without_newline(path: pathlib.Path) -> bool:
    """Returns whether a non-empty file ends without a line feed."""
    if not path.exists() or not path.stat().st_size:
        return False
    with open(path, "rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read() != b"\n"


def read_scores(path: pathlib.Path) -> dict[Key, list[Row]]:
    """Reads the scores of each record, grouped by the values of the columns HEAD. If a record
    occurs several times, its last line counts. Incomplete lines are skipped."""
    found: dict[Key, dict[str, Row]] = {}
    if path.exists():
        with open(path, newline="", encoding="utf-8") as file:
            for line in csv.DictReader(text for text in file if not text.startswith("#")):
                if line["record"] != "record" and None not in line.values():
                    found.setdefault(tuple(line[name] for name in HEAD), {})[line["record"]] = {
                        name: line[name] for name in ("record", *RECORDED)}
    return {key: list(lines.values()) for key, lines in found.items()}


def compare(table: Table, axis: str, best_first: Sequence[Key]) -> dict[Key, Row]:
    """Runs `echofuse-recon compare` and returns its result for each method (value, model, inputs):
    95 % intervals over the records, and differences from the first method of `best_first`. The
    score of a record is its mean over the seeds."""
    scores = read_scores(table.records)
    rows = [row for key, row in table.rows.items() if key[0] == axis]
    lines = [(record["record"], k, *(record[name] for name in RECORDED))
             for k, method in enumerate(best_first) for row in rows if Table.key(row)[1:4] == method
             for record in scores.get((*Table.key(row), str(row["source"])), ())]
    if not lines:
        return {}
    with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
        path = pathlib.Path(scratch, "records.csv")
        with open(path, "w", newline="") as file:
            csv.writer(file).writerows([("record", "name", *RECORDED), *lines])
        methods = json.loads(call("echofuse-recon", "compare", path, "--json").stdout)["methods"]
    return {best_first[int(method["name"])]: method for method in methods}


def checksum(path: Path) -> str:
    """Returns the SHA-256 of the sensor data of a run: counts, stored profiles and depths in mm."""
    total = hashlib.sha256()
    with runs.open(path) as run:
        total.update(run.spd.astype("<u4").tobytes())
        total.update(run.radar.astype("<f4").tobytes())
        for row in range(len(run)):
            total.update(run.depth_mm(row).astype("<u2").tobytes())
    return total.hexdigest()


def content_hash(path: Path) -> str:
    """Returns a hash of a run's sensor data, axes, offsets, record indices and quality verdicts.
    The hash does not depend on the recording times or the UUID."""
    with runs.open(path) as run:
        facts = (sorted(map(repr, run.axes.values())), sorted(run.offset_m.items()),
                 run.index.tolist(),
                 {name: column.tolist() for name, column in run.quality().items()
                  if name.endswith("_verdict")})
    return hashlib.sha256((repr(facts) + checksum(path)).encode()).hexdigest()[:16]


def source_line(train: Path, test: Path) -> str:
    """Returns the first line of a table of results measured on these runs. The line contains the
    program version and the content hashes of the runs."""
    return f"{version()}: runs {content_hash(train)} {content_hash(test)}"


@dataclass(frozen=True)
class RunSource:
    """A run that is generated on demand."""

    key: str  #: unique name of the run
    #: writes the run into a folder and returns its path
    make: Callable[[pathlib.Path], pathlib.Path]


def existing_run(path: Path) -> RunSource:
    """Returns a RunSource for an existing run."""
    resolved = pathlib.Path(path).resolve()
    return RunSource(str(resolved), lambda folder: resolved)


@dataclass(frozen=True)
class Cell:
    """A table row to be measured."""

    axis: str  #: name of the property that is varied
    value: str  #: value of the varied property
    method: Method  #: method to measure
    seed: int  #: random seed for training
    train: RunSource  #: training run
    test: RunSource  #: test run
    #: whether a model that uses both sensors also predicts records with only one sensor
    fallback: bool = False

    @property
    def head(self) -> Row:
        """Columns that are known before the measurement."""
        return {"axis": self.axis, "value": self.value, "model": self.method.model,
                "inputs": self.method.inputs, "seed": self.seed}

    @property
    def fit_key(self) -> str:
        """Key under which the class Shared stores the trained method."""
        return f"{self.method.name} {self.seed} {self.fallback} {self.train.key}"

    @property
    def test_input_key(self) -> str:
        """Key under which the class Shared stores the test run without ground-truth maps."""
        return f"{self.test.key} without truth"

    @property
    def needs(self) -> tuple[str, ...]:
        """Keys of all runs and trained methods used by the cell."""
        return self.train.key, self.test.key, self.test_input_key, self.fit_key


class Shared:
    """Runs and trained methods shared by several cells. Each run or method is created on its first
    use, and removed after its last use."""

    def __init__(self, cells: Sequence[Cell], folder: pathlib.Path) -> None:
        self.folder, self.lock = folder, threading.Lock()
        self.pending = collections.Counter(key for cell in cells for key in cell.needs)
        self.results: dict[str, tuple[pathlib.Path, concurrent.futures.Future[Any]]] = {}

    def get(self, key: str, make: Callable[[pathlib.Path], Any]) -> Any:
        with self.lock:
            first = key not in self.results
            if first:
                self.results[key] = pathlib.Path(
                    tempfile.mkdtemp(dir=self.folder)), concurrent.futures.Future()
            folder, result = self.results[key]
        if first:
            try:
                result.set_result(make(folder))
            except Exception as error:  # noqa: BLE001 (raised in all waiting threads)
                result.set_exception(error)
        return result.result()

    def row(self, cell: Cell) -> tuple[Row, list[Row]]:
        try:
            train = self.get(cell.train.key, cell.train.make)
            method = cell.method
            predict = self.get(cell.fit_key, lambda folder: method.fit(train, folder, cell.seed,
                                                                       cell.fallback))
            test = self.get(cell.test.key, cell.test.make)
            test_input = (self.get(cell.test_input_key,
                                   lambda folder: method.test_input(test, folder))
                          if method.is_blind else test)
            return evaluate(predict, train, test, test_input)
        finally:
            with self.lock:
                for key in cell.needs:
                    self.pending[key] -= 1
                    if self.pending[key] == 0 and key in self.results:
                        shutil.rmtree(self.results.pop(key)[0])


def fill(table: Table, cells: Sequence[Cell], *, jobs: int = 1, part: tuple[int, int] = (1, 1),
         quiet: bool = False) -> None:
    """Measures the missing rows of the table; if part = (K, N), only those in part K of N. Cells
    that use the same trained method are in the same part. If a method fails, its row contains NaN,
    its traceback is written to the log file, and its error message is printed once. Raises OSError
    or sqlite3.Error if, for example, a file is missing or the disk is full."""
    pieces = {key: k for k, key in enumerate(dict.fromkeys(cell.fit_key for cell in cells))}
    printed: set[str] = set()

    def measure(cell: Cell) -> tuple[Row, list[Row], Exception | None]:
        before, fault = cell.method.files(), None
        try:
            row, records = shared.row(cell)
        except (UsageError, OSError, sqlite3.Error):  # these errors are not caused by the method
            raise
        except Exception as error:  # noqa: BLE001 (user code)
            row, records = dict.fromkeys(METRICS + COSTS + COUNTS, float("nan")), []
            fault = error
        # A file that changed is an output of the method.
        files = json.dumps({name: found for name, found in cell.method.files().items()
                            if found == before.get(name, found)})
        source = hashlib.sha256(files.encode()).hexdigest()[:12]
        return cell.head | row | {"files": files, "source": source}, records, fault

    with (table.exclusive(), tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch,
          concurrent.futures.ThreadPoolExecutor(jobs) as pool):
        mine = [cell for cell in cells if pieces[cell.fit_key] % part[1] == part[0] - 1
                and not table.has(cell)]
        if reused := sum(map(table.has, cells)):
            print(f"echofuse-bench: reused rows: {reused}", file=sys.stderr)
        shared = Shared(mine, pathlib.Path(scratch))
        started = time.monotonic()
        for done, (cell, (row, records, fault)) in enumerate(zip(mine, pool.map(measure, mine)), 1):
            table.add(row, records)
            if not fault and row["answered"] < row["records"]:
                print(f"echofuse-bench: {row['model']}: {row['answered']} of {row['records']} "
                      "records have a map; the other records " + ("are scored as empty "
                         "maps" if cell.method.is_user_method else "are excluded"), file=sys.stderr)
            if fault:
                table.failed += cell.method.is_user_method
                table.log_failure(row, fault)
                if (reason := str(fault) or type(fault).__name__) not in printed:
                    printed.add(reason)
                    print(f"echofuse-bench: {row['model']}: {reason}", file=sys.stderr)
            if not quiet:
                left_s = (time.monotonic() - started) / done * (len(mine) - done)
                print(f"\rbench: {done} of {len(mine)} rows, {left_s:.0f} s left   ",
                      end="" if sys.stderr.isatty() else "\n", file=sys.stderr, flush=True)


def pareto_cells(train: Path, test: Path, methods: Iterable[Method], *, seeds: int = 3,
                 photons: Sequence[float] = (0.1, 0.01, 0.001),
                 records: Sequence[float] = (0.05, 0.2, 0.5), sweep: Iterable[Method] = (),
                 axis: str = "model") -> list[Cell]:
    """Returns one cell per method and seed. For each method in `sweep`, also returns cells in which
    only a fraction of the photons (`photons`) or of the training records (`records`) is used."""
    train_run, test_run = existing_run(train), existing_run(test)
    cells = [Cell(axis, "1", method, seed, train_run, test_run) for method in methods
             for seed in range(1, seeds + 1)]

    def derived(source: RunSource, name: str, *changes: derive.Change) -> RunSource:
        return RunSource(f"{source.key} {name}",
                         lambda folder: derive.copy(source.make(folder), folder / "run.sqlite",
                                                    *changes))

    for method in sweep:
        for seed in range(1, seeds + 1):
            cells += [Cell("photons", f"{share:g}", method, seed,
                           derived(train_run, f"thinned {share} {seed}",
                                   derive.thinned(share, seed)),
                           derived(test_run, f"thinned {share} {seed}",
                                   derive.thinned(share, 1000 + seed))) for share in photons]
            cells += [Cell("records", f"{share:g}", method, seed,
                           derived(train_run, f"fewer {share} {seed}", derive.fewer(share, seed)),
                           test_run) for share in records]
    return cells


def means(table: Table, axis: str = "model") -> list[Row]:
    """Returns one row per method and value. Each row contains the mean of each metric and cost over
    the seeds (NAME), and its standard deviation (NAME_spread). "compared" is the comparison of the
    method with the one that has the highest IoU (`echofuse-recon compare`)."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for key, row in table.rows.items():
        if row["axis"] == axis:
            groups.setdefault(key[1:4], []).append(row)
    out = []
    for (value, model, inputs), rows in groups.items():
        mean: Row = {"value": value, "model": model, "inputs": inputs, "seeds": len(rows)}
        for name in METRICS + COSTS + COUNTS:
            values = np.array([float(row[name]) for row in rows])
            mean[name] = float(values.mean())
            mean[name + "_spread"] = float(values.std(ddof=1)) if len(values) > 1 else float("nan")
        out.append(mean)
    by_iou = sorted(out, key=lambda row: -float(np.nan_to_num(row["iou"], nan=-1)))
    compared = compare(table, axis, [(row["value"], row["model"], row["inputs"]) for row in by_iou])
    for row in out:
        row["compared"] = compared.get((row["value"], row["model"], row["inputs"]), {})
    return out


def markdown(rows: Sequence[Row]) -> str:
    """Returns a Markdown table, in which the rows are grouped by inputs."""
    head = ("inputs", "method", "answered", "IoU", "95 % interval over the records",
            "IoU difference from the best", "depth error in the overlap (number of maps)",
            "SSIM on the foreground", "lateral error", "mirror fraction", "multiply-adds",
            "time per single map", "time per map in a batch", "threads")
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    order = {"-": 0, "fused": 1, "fused-profile": 2, "spd": 3, "radar": 4}

    def number(row: Row, name: str, digits: int, unit: float = 1, suffix: str = "") -> str:
        mean, spread = unit * row[name], unit * row[name + "_spread"]
        if np.isnan(mean):
            return ""
        return f"{mean:.{digits}f}" + ("" if np.isnan(spread)
                                       else f" ± {spread:.{digits}f}") + suffix

    def time_of(us: float) -> str:
        return "" if np.isnan(us) else f"{us:.0f} µs"

    def interval(of: Row, form: str) -> str:
        return "" if of.get("low") is None else f"{of['low']:{form}} to {of['high']:{form}}"

    def gain(of: Row) -> str:
        return f"{of['mean']:+.3f} ({interval(of, '+.3f')})" if interval(of, "") else ""

    for row in sorted(rows, key=lambda row: order.get(row["inputs"], 9)):
        cost = ("" if np.isnan(row["multiply_adds"])
                else f"{row['multiply_adds']:,.0f}".replace(",", " "))
        inputs = row["inputs"] + (f", {row['value']}" if row["value"] != "1" else "")
        answered, records, maps, threads = ("" if np.isnan(row[name]) else f"{row[name]:.0f}"
                                            for name in COUNTS)
        of_records = row["compared"].get("metrics", {}).get("iou", {})
        against = row["compared"].get("difference", {}).get("iou", {})
        depth = number(row, "depth_mae_m", 1, 100, " cm")
        lines.append("| " + " | ".join((inputs, f"`{row['model']}`",
                                        f"{answered} of {records}" if records else "",
                                        number(row, "iou", 3), interval(of_records, ".3f"),
                                        gain(against), depth and f"{depth} ({maps})",
                                        number(row, "ssim_fg", 3),
                                        number(row, "lateral_m", 1, 100, " cm"),
                                        number(row, "ghost", 3), cost,
                                        time_of(row["infer_us_median"]),
                                        time_of(row["infer_us_batch"]), threads)) + " |")
    return "\n".join(lines)


def finish(table: Table, args: argparse.Namespace, draw: Callable[[Any], Any],
           axis: str = "model") -> None:
    """Prints the table as Markdown if --markdown was given, and draws the figure if --figure was
    given."""
    if args.markdown:
        print(markdown(means(table, axis)))
    if args.figure:
        from .. import plot

        figure = draw(plot)
        with writing(args.figure):
            figure.savefig(args.figure)
