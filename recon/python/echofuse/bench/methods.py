# SPDX-License-Identifier: MIT
"""Methods of the bench: candidates of `echofuse-recon train`, Python classes, commands; and their
one judge."""
from __future__ import annotations

import contextlib
import csv
import hashlib
import importlib.util
import inspect
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..models.maps import save_maps
from ..runs.programs import BenchError, UsageError, call
from ..runs.splits import split, usual_inputs
from . import derive

METRICS = ("iou", "ssim", "ssim_hard", "ssim_fg", "rmse_m", "rmse_fg_m", "depth_mae_m", "abs_rel",
           "delta_125", "lateral_m",
           "ghost", "left_right")
COSTS = ("multiply_adds", "infer_us_median", "infer_us_p99", "infer_us_batch", "train_s")
RECORDED = ("iou", "lateral_m", "depth_mae_m", "ssim_fg")  # scores kept of each record
COUNTS = ("answered", "records", "depth_maps", "threads")
CONSTANT = ("empty", "mean")  # look at no sensor
Path = str | pathlib.Path
Row = dict[str, Any]


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Makes of an OSError a BenchError of exit code 6 that names the path."""
    try:
        yield
    except OSError as error:
        raise BenchError(f"{path}: cannot write ({error.strerror or error})", 6) from None


def version() -> str:
    """As "echofuse-recon 0.1.0 (8e0b8d8)"."""
    return call("echofuse-recon", "--version").stdout.split(",")[0].strip()


class Fitted(Protocol):
    """The interface of a method in Python. `rows` are indices into the run's records to learn
    from."""

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None: ...

    def predict(self, run: runs.Run) -> NDArray[np.float32]: ...


Answer = Callable[[pathlib.Path, pathlib.Path], tuple[list[str], Row]]


@dataclass(frozen=True)
class Method:
    """A name, and how to learn from a run: fit(train, folder, seed, fallback) gives answer(test,
    folder), and this the words that `evaluate` takes, and costs. fallback: a candidate of both
    sensors answers for records of one, too. source: hash of the code of a method of one's own.
    oracle: predict() gets the truth, too (class attribute `oracle`)."""

    model: str  #: name of the candidate, class or command
    inputs: str  #: sensors that it takes; "-": its own choice
    fit: Callable[[pathlib.Path, pathlib.Path, int, bool], Answer]  #: learns from a run
    source: str = "-"  #: hash of the code of a method of one's own
    oracle: bool = False  #: predict() gets the truth, too

    @property
    def name(self) -> str:
        """Its model, and its inputs if they are not the usual ones."""
        return self.model if self.inputs in ("fused", "-") else f"{self.model}:{self.inputs}"

    @property
    def own(self) -> bool:
        """Whether it is a class or a command of the user."""
        return self.inputs == "-" and self.model not in CONSTANT

    def shown(self, test: pathlib.Path, folder: pathlib.Path) -> pathlib.Path:
        """The test run as this method gets it: a method of one's own gets a copy without truth."""
        if not self.own or self.oracle:
            return test
        return derive.copy(test, folder / "test.sqlite", derive.lost("depth"))


def source_of(*paths: str | None) -> str:
    """Hash of these files, without those that are missing."""
    total = hashlib.sha256()
    for path in paths:
        if path and os.path.isfile(path):
            total.update(pathlib.Path(path).read_bytes())
    return total.hexdigest()[:12]


def method(text: str) -> Method:
    """Returns the method of this name (kinds: echofuse-bench --help). Raises UsageError for a
    class that is missing."""
    if "/" in text:
        words = shlex.split(text)
        return Method(text, "-", lambda train, folder, seed,
                      fallback: _by_command(text, train, seed),
                      source_of(shutil.which(words[0]), *words[1:]))
    module, _, name = text.partition(":")
    if "." in module or name[:1].isupper():
        try:
            made = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError) as error:
            raise UsageError(f"method {text}: {error}") from error
        return python_method(text, made)
    inputs = "-" if module in CONSTANT and not name else name or "fused"
    return Method(module, inputs, lambda train, folder, seed,
                  fallback: _by_candidate(module, inputs, train, folder, seed, fallback))


def python_method(name: str, make: Callable[..., Fitted]) -> Method:
    """A method of this name: make() or make(seed=...) gives an object with fit and predict."""
    module = sys.modules.get(getattr(make, "__module__", ""))
    return Method(name, "-", lambda train, folder, seed, fallback: _by_object(make, train, seed),
                  source_of(getattr(module, "__file__", None)),
                  bool(getattr(make, "oracle", False)))


def _by_candidate(model: str, inputs: str, train: pathlib.Path, folder: pathlib.Path, seed: int,
                  fallback: bool) -> Answer:
    out = folder / "model.safetensors"
    words = ["--inputs", inputs] if inputs not in ("fused", "-") else []
    call("echofuse-recon", "-q", "train", train, "--model", model, *words, "--seed", seed, "--set",
         "test_share=0",
         "--set", f"fallback={'true' if fallback else 'false'}", "--out", out)
    return lambda test, scratch: ([str(out)], {})


def _by_object(make: Callable[..., Fitted], train: pathlib.Path, seed: int) -> Answer:
    try:
        inspect.signature(make).bind(seed=seed)
    except (TypeError, ValueError):  # it takes no seed, or states no parameters
        one = make()
    else:
        one = make(seed=seed)
    with runs.open(train) as known:
        started = time.perf_counter()
        inputs = usual_inputs(known).replace("fused", "fused-profile")  # also without antennas
        one.fit(known, split(known, inputs=inputs, test_share=0, validation_share=0).train)
        train_s = time.perf_counter() - started

    def answer(test: pathlib.Path, folder: pathlib.Path) -> tuple[list[str], Row]:
        with runs.open(test) as fresh:
            maps, us = timed(one, fresh)
            if maps.ndim != 3 or len(maps) != len(fresh) or maps.shape[1] != maps.shape[2]:
                raise BenchError(
                    f"{type(one).__name__}.predict gave {maps.shape}; expected [{len(fresh)}, N, "
                    "N]")
            save_maps(folder / "maps", maps, fresh.index)
            costs = {"train_s": train_s, "infer_us_batch": us / max(len(fresh), 1)}
            return ["--maps", str(folder / "maps")], costs | alone(one, fresh)

    return answer


def timed(one: Fitted, run: runs.Run) -> tuple[NDArray[np.float32], float]:
    """Maps [n, N, N] of a run in memory, and the time of the prediction, microseconds."""
    for sensor, valid in run.valid.items():
        if valid.any():
            getattr(run, sensor)  # stays in memory
    started = time.perf_counter()
    maps = np.asarray(one.predict(run), np.float32)
    return maps, 1e6 * (time.perf_counter() - started)


def alone(one: Fitted, run: runs.Run, most: int = 30) -> Row:
    """Times of a map if the records come one at a time; none of a method that takes several
    only."""
    rows = np.unique(np.linspace(0, len(run) - 1, min(len(run), most)).astype(int)).tolist()
    try:
        us = [timed(one, run[row:row + 1])[1] for row in rows]
    except Exception:  # noqa: BLE001 (a method of anybody's)
        us = []
    return {"infer_us_median": np.median(us), "infer_us_p99": np.quantile(us, 0.99)} if us else {}


def _by_command(text: str, train: pathlib.Path, seed: int) -> Answer:
    def answer(test: pathlib.Path, folder: pathlib.Path) -> tuple[list[str], Row]:
        started = time.perf_counter()
        done = subprocess.run([*shlex.split(text), train, test, folder / "maps"],
                              capture_output=True, text=True,
                              env=os.environ | {"ECHOFUSE_SEED": str(seed)}, check=False)
        if done.returncode:
            error = BenchError(
                f"{text}: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")
            error.add_note(done.stderr.strip())
            raise error
        named = folder / "maps/run.txt"  # names the copy without truth that the method got
        if named.exists() and named.read_text().startswith(runs.open(test).info["uuid"]):
            named.unlink()
        return ["--maps", str(folder / "maps")], {"train_s": time.perf_counter() - started}

    return answer


def judge(answer: Answer, train: pathlib.Path, test: pathlib.Path,
          shown: pathlib.Path) -> tuple[Row, list[Row]]:
    """Metrics (means over the records) and costs; and the scores of each record. shown:
    Method.shown(test). Multiply-adds and times of a map are the program's own for its candidates.
    Time of a class is that of predict() with the run in memory."""
    with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
        words, costs = answer(shown, pathlib.Path(scratch))
        listed = pathlib.Path(scratch, "records.csv")
        told = json.loads(call("echofuse-recon", "-q", "evaluate", *words, test, "--train", train,
                               "--json", "--per-record", listed).stdout)
        with open(listed, newline="", encoding="utf-8") as lines:
            records = [{name: line[name] for name in ("record", *RECORDED)}
                       for line in csv.DictReader(lines)]
    row: Row = {name: nan_if_none(told["metrics"].get(name, {}).get("mean")) for name in METRICS}
    counts = {"answered": told.get("answered", told["records"]), "records": told["records"],
              "depth_maps": told["metrics"]["depth_mae_m"]["maps"],
              "threads": 1 if told.get("cost")  # the program's own times are those of one thread
              else int(os.environ.get("OMP_NUM_THREADS") or os.cpu_count() or 1)}
    if "answered" not in told:  # of a model only the records with a map are judged
        counts["records"] += told["left_out"]
    cost = costs | (told.get("cost") or {})
    return row | counts | {name: nan_if_none(cost.get(name)) for name in COSTS}, records


def measure(how: Method, train: Path, test: Path, seed: int = 1) -> Row:
    """Scores of the method, trained on one run and judged on another."""
    train, test = pathlib.Path(train).resolve(), pathlib.Path(test).resolve()
    with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
        folder = pathlib.Path(scratch)
        return judge(how.fit(train, folder, seed, True), train, test, how.shown(test, folder))[0]


def nan_if_none(value: float | None) -> float:
    return float("nan") if value is None else float(value)
