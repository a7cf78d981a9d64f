# SPDX-License-Identifier: MIT
"""The table of a bench, and the cells that fill it."""
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
from ..runs.programs import BenchError, UsageError, call
from ..runs.staged import locked, sync
from . import derive
from .methods import COSTS, COUNTS, METRICS, RECORDED, Method, Path, Row, judge, version, writing

HEAD = ("axis", "value", "model", "inputs", "seed", "source")
COLUMNS = (*HEAD, *METRICS, *COSTS, *COUNTS)
COLUMNS_OF_RECORDS = (*HEAD, "record", *RECORDED)


class Table:
    """Rows of a CSV file, by axis, value, model, inputs and seed; the last one of several counts. A
    row with the method's source is not measured again; each new one is on the disk before the next.
    failed: rows of one's own methods that failed, with a traceback in the log. `of`: the first
    line, which names the data; another one is refused (BenchError). A part (k, n) is a file beside
    it, NAME-part-k-of-n.csv; the whole takes the rows of all parts that are there. Files one behind
    the other (cat) are one, too. NAME.records.csv has the scores of each record."""

    def __init__(self, path: Path, of: str = "", part: tuple[int, int] = (1, 1)) -> None:
        whole = pathlib.Path(path)
        self.path = whole if part[1] == 1 else whole.with_name(
            f"{whole.stem}-part-{part[0]}-of-{part[1]}{whole.suffix}")
        self.of, self.log, self.failed = of, self.path.with_suffix(".log"), 0
        self.records = self.path.with_suffix(".records.csv")
        self.rows: dict[tuple[str, ...], Row] = {}
        here = self._read(self.path)
        if part[1] == 1:
            for other in sorted(whole.parent.glob(f"{whole.stem}-part-*-of-*{whole.suffix}")):
                if other.name.endswith(".records.csv"):
                    continue
                scores = scores_in(other.with_suffix(".records.csv"))
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
        """Identity of a row: axis, value, model, inputs, seed."""
        return tuple(str(row[name]) for name in COLUMNS[:5])

    def has(self, cell: Cell) -> bool:
        """Whether the row is there. A failed method of one's own is tried again."""
        row = self.rows.get(self.key(cell.head))
        return (row is not None and row["source"] == cell.how.source
                and not (cell.how.own and np.isnan(float(row["iou"]))))

    def add(self, row: Row, records: Sequence[Row] = ()) -> None:
        """Writes the row into the file, in place of one with its key, and its records' scores."""
        before = self.rows.get(self.key(row), {"source": ""})
        self.rows[self.key(row)] = row
        if before["source"] == row["source"] and np.isnan(float(row["iou"])):
            return  # it failed again
        head = {name: row[name] for name in HEAD}
        with writing(self.path):  # the records first: a row that is there has them
            if records:
                self._append(self.records, COLUMNS_OF_RECORDS, [head | one for one in records])
            self._append(self.path, COLUMNS, [row])

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Reads what other processes wrote, and keeps them from measuring the same rows."""
        lock = self.path.with_name(f".{self.path.name}.lock")
        with writing(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            try:
                descriptor = locked(lock)
            except BlockingIOError:
                raise BenchError(f"{self.path}: another process writes this table; wait for its "
                                 "end, or share the work with --part K/N") from None
        try:
            self.rows |= self._read(self.path)
            yield
        finally:
            lock.unlink()
            os.close(descriptor)

    def note(self, row: Row, error: BaseException) -> None:
        """Appends the traceback of a failed method to the log."""
        with writing(self.log), open(self.log, "a", encoding="utf-8") as file:
            file.write(" ".join(self.key(row)) + "\n"
                       + "".join(traceback.format_exception(error)) + "\n")

    def _append(self, path: pathlib.Path, columns: Sequence[str], rows: Iterable[Row]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        half = ends_within_a_line(path)  # by a kill
        with open(path, "a", newline="") as file:
            file.write("\n" * half)
            out = csv.DictWriter(file, columns, restval="nan", lineterminator="\n")
            if new := file.tell() == 0:
                file.write(f"# {self.of}\n" if self.of else "")
                out.writeheader()
            out.writerows({name: f"{value:.9g}" if isinstance(value, float) else value
                           for name, value in row.items()} for row in rows)
        sync(path)
        if new:
            sync(path.parent)


Key = tuple[str, ...]


def ends_within_a_line(path: pathlib.Path) -> bool:
    """Whether a file lacks its last line feed; False for an empty or missing file."""
    if not path.exists() or not path.stat().st_size:
        return False
    with open(path, "rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read() != b"\n"


def scores_in(path: pathlib.Path) -> dict[Key, list[Row]]:
    """Scores of each record, by the columns HEAD of their row; the last line of a record counts.
    Half a line, of a killed process, does not."""
    found: dict[Key, dict[str, Row]] = {}
    if path.exists():
        with open(path, newline="", encoding="utf-8") as file:
            for line in csv.DictReader(one for one in file if not one.startswith("#")):
                if line["record"] != "record" and None not in line.values():
                    found.setdefault(tuple(line[name] for name in HEAD), {})[line["record"]] = {
                        name: line[name] for name in ("record", *RECORDED)}
    return {key: list(lines.values()) for key, lines in found.items()}


def compared(table: Table, axis: str, best_first: Sequence[Key]) -> dict[Key, Row]:
    """Intervals of 95 % over the records, and differences to the first, of these methods (value,
    model, inputs) by `echofuse-recon compare`; the scores of a record are the mean of the
    seeds."""
    scores = scores_in(table.records)
    rows = [row for key, row in table.rows.items() if key[0] == axis]
    lines = [(one["record"], k, *(one[name] for name in RECORDED))
             for k, wanted in enumerate(best_first) for row in rows
             if Table.key(row)[1:4] == wanted
             for one in scores.get((*Table.key(row), str(row["source"])), ())]
    if not lines:
        return {}
    with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
        listed = pathlib.Path(scratch, "records.csv")
        with open(listed, "w", newline="") as file:
            csv.writer(file).writerows([("record", "name", *RECORDED), *lines])
        methods = json.loads(call("echofuse-recon", "compare", listed, "--json").stdout)["methods"]
    return {best_first[int(one["name"])]: one for one in methods}


def checksum(path: Path) -> str:
    """SHA-256 of what the sensors of a run hold, record by record: counts, profiles as stored,
    depths in millimetres."""
    total = hashlib.sha256()
    with runs.open(path) as run:
        total.update(run.spd.astype("<u4").tobytes())
        total.update(run.stored_radar().astype("<f4").tobytes())
        for row in range(len(run)):
            total.update(run.depth_mm(row).astype("<u2").tobytes())
    return total.hexdigest()


def content(path: Path) -> str:
    """Hash of a run's records with their axes, offsets and verdicts. The same data made again have
    the same one."""
    with runs.open(path) as run:
        facts = (sorted(map(repr, run.axes.values())), sorted(run.offset_m.items()),
                 run.index.tolist(), {name: column.tolist() for name, column in run.told().items()
                                      if name.startswith("verdict")})
    return hashlib.sha256((repr(facts) + checksum(path)).encode()).hexdigest()[:16]


def of_runs(train: Path, test: Path) -> str:
    """Source line of a table of these runs: version and content."""
    return f"{version()}: runs {content(train)} {content(test)}"


@dataclass(frozen=True)
class Source:
    """A run to come: make(folder) writes it there, and returns its path. Equal keys are the same
    run."""

    key: str  #: identity of the run
    make: Callable[[pathlib.Path], pathlib.Path]  #: writes it into a folder, returns its path


def there(path: Path) -> Source:
    """A run that is there."""
    found = pathlib.Path(path).resolve()
    return Source(str(found), lambda folder: found)


@dataclass(frozen=True)
class Cell:
    """One row to come."""

    axis: str  #: condition that changes
    value: str  #: its value
    how: Method  #: to be measured
    seed: int  #: of the training
    train: Source  #: run to learn from
    test: Source  #: run to judge by
    fallback: bool = False  #: records of one sensor are answered, too

    @property
    def head(self) -> Row:
        """Columns of its row that are known before it is measured."""
        return {"axis": self.axis, "value": self.value, "model": self.how.model,
                "inputs": self.how.inputs, "seed": self.seed, "source": self.how.source}

    @property
    def fitted(self) -> str:
        """Key of what it needs fitted."""
        return f"{self.how.name} {self.seed} {self.fallback} {self.train.key}"

    @property
    def shown(self) -> str:
        """Key of the test run as the method gets it."""
        return f"{self.test.key} without truth"

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the runs and fitted methods that it uses."""
        return self.train.key, self.test.key, self.shown, self.fitted


class Shared:
    """Runs and fitted methods of the cells: made at the first use, removed after the last one."""

    def __init__(self, cells: Sequence[Cell], folder: pathlib.Path) -> None:
        self.folder, self.lock = folder, threading.Lock()
        self.left = collections.Counter(key for cell in cells
                                        for key in cell.needs)
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

    def row(self, cell: Cell) -> tuple[Row, list[Row]]:
        try:
            train = self.get(cell.train.key, cell.train.make)
            answer = self.get(cell.fitted,
                              lambda folder: cell.how.fit(train, folder, cell.seed, cell.fallback))
            test = self.get(cell.test.key, cell.test.make)
            shown = (self.get(cell.shown, lambda folder: cell.how.shown(test, folder))
                     if cell.how.own and not cell.how.oracle else test)
            return judge(answer, train, test, shown)
        finally:
            with self.lock:
                for key in cell.needs:
                    self.left[key] -= 1
                    if self.left[key] == 0 and key in self.made:
                        shutil.rmtree(self.made.pop(key)[0])


def fill(table: Table, cells: Sequence[Cell], *, jobs: int = 1, part: tuple[int, int] = (1, 1),
         quiet: bool = False) -> None:
    """Measures what the table lacks, or this part of it. Cells with the same fitted method are in
    one part. A method that fails has a row of NaN; reasons are said once, tracebacks are in the
    log. Raises OSError, sqlite3.Error: a missing file and a full disk say nothing of a method."""
    pieces = {key: k for k, key in enumerate(dict.fromkeys(cell.fitted for cell in cells))}
    said: set[str] = set()

    def one(cell: Cell) -> tuple[Row, list[Row], Exception | None]:
        try:
            row, records = shared.row(cell)
            return cell.head | row, records, None
        except (UsageError, OSError, sqlite3.Error):  # no fault of the method
            raise
        except Exception as error:  # noqa: BLE001 (a method of anybody's)
            return cell.head | dict.fromkeys(METRICS + COSTS + COUNTS, float("nan")), [], error

    with (table.held(), tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch,
          concurrent.futures.ThreadPoolExecutor(jobs) as pool):
        mine = [cell for cell in cells if pieces[cell.fitted] % part[1] == part[0] - 1
                and not table.has(cell)]
        shared = Shared(mine, pathlib.Path(scratch))
        started = time.monotonic()
        for done, (cell, (row, records, fault)) in enumerate(zip(mine, pool.map(one, mine)), 1):
            table.add(row, records)
            if not fault and row["answered"] < row["records"]:
                print(f"echofuse-bench: {row['model']}: {row['answered']} of {row['records']} "
                      "records answered; the others "
                      + ("count as an empty map" if cell.how.own else "are left out"),
                      file=sys.stderr)
            if fault:
                table.failed += cell.how.own
                table.note(row, fault)
                if (reason := str(fault) or type(fault).__name__) not in said:
                    said.add(reason)
                    print(f"echofuse-bench: {row['model']}: {reason}", file=sys.stderr)
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
    and value; and as "compared" what `echofuse-recon compare` states of its records, against the
    method of the highest IoU."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for key, row in table.rows.items():
        if row["axis"] == axis:
            groups.setdefault(key[1:4], []).append(row)
    out = []
    for (value, model, inputs), rows in groups.items():
        one: Row = {"value": value, "model": model, "inputs": inputs, "seeds": len(rows)}
        for name in METRICS + COSTS + COUNTS:
            values = np.array([float(row[name]) for row in rows])
            one[name] = float(values.mean())
            one[name + "_spread"] = float(values.std(ddof=1)) if len(values) > 1 else float("nan")
        out.append(one)
    by_iou = sorted(out, key=lambda one: -float(np.nan_to_num(one["iou"], nan=-1)))
    found = compared(table, axis, [(one["value"], one["model"], one["inputs"]) for one in by_iou])
    for one in out:
        one["compared"] = found.get((one["value"], one["model"], one["inputs"]), {})
    return out


def markdown(rows: Sequence[Row]) -> str:
    """A table for a README: rows of equal inputs together."""
    head = ("inputs", "method", "answered", "IoU", "95 % over records", "IoU against the best",
            "depth error on the overlap (maps)", "SSIM on the foreground", "lateral error",
            "mirror fraction",
            "multiply-adds", "time of a map, one at a time", "in a batch", "threads")
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    order = {"-": 0, "fused": 1, "fused-profile": 2, "spd": 3, "radar": 4}

    def number(row: Row, name: str, digits: int, unit: float = 1, behind: str = "") -> str:
        mean, spread = unit * row[name], unit * row[name + "_spread"]
        if np.isnan(mean):
            return ""
        return f"{mean:.{digits}f}" + ("" if np.isnan(spread)
                                       else f" ± {spread:.{digits}f}") + behind

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
    """Ends each command: prints the table for a README, draws the figure."""
    if args.markdown:
        print(markdown(means(table, axis)))
    if args.figure:
        from .. import plot

        figure = draw(plot)
        with writing(args.figure):
            figure.savefig(args.figure)
