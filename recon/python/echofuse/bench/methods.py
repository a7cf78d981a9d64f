# SPDX-License-Identifier: MIT
"""Trains and scores the methods of the bench: models that `echofuse-recon train` offers, Python
classes, and commands."""
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
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..models.maps import save_maps
from ..runs.arguments import plain
from ..runs.programs import ProgramError, UsageError, call
from ..runs.splits import split, usual_inputs
from . import derive

__all__ = ["CONSTANT", "COSTS", "COUNTS", "METRICS", "RECORDED", "Method", "Path", "Row",
           "evaluate", "measure", "method", "nan_if_none", "python_method", "version", "writing"]

METRICS = ("iou", "ssim", "ssim_hard", "ssim_fg", "rmse_m", "rmse_fg_m", "depth_mae_m", "abs_rel",
           "delta_125", "lateral_m", "ghost", "left_right")
COSTS = ("multiply_adds", "infer_us_median", "infer_us_p99", "infer_us_batch", "train_s")
RECORDED = ("iou", "lateral_m", "depth_mae_m", "ssim_fg")  # scores that are stored for each record
COUNTS = ("answered", "records", "depth_maps", "threads")
DATA = (".sqlite", ".csv", ".log", ".svg", ".pdf", ".png")  # runs, and files that the bench writes
PACKAGES = ("site-packages", "dist-packages")  # folders of installed Python packages
MAX_HASHED = 1 << 26  # maximum size of files with hashed contents, bytes
CONSTANT = ("empty", "mean")  # baselines that use no sensor data
Path = str | pathlib.Path
Row = dict[str, Any]


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Converts an OSError into a ProgramError that includes the path and has exit code 6."""
    try:
        yield
    except OSError as error:
        raise ProgramError(f"{path}: cannot write ({error.strerror or error})", 6) from None


def version() -> str:
    """Returns the version of echofuse-recon, e.g. "echofuse-recon 0.1.0 (8e0b8d8)"."""
    return call("echofuse-recon", "--version").stdout.split(",")[0].strip()


class Fitted(Protocol):
    """Interface of a method implemented in Python."""

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None:
        """Trains the method on the given rows of a run."""

    def predict(self, run: runs.Run) -> NDArray[np.float32]:
        """Returns one depth map per record [n, N, N], m, with NaN for no return."""


# predict(test, folder) returns arguments for `echofuse-recon evaluate`, and measured costs by name
Predict = Callable[[pathlib.Path, pathlib.Path], tuple[list[str], Row]]


@dataclass(frozen=True)
class Method:
    """A method that the bench can train and test."""

    model: str  #: the name of a model, a class or a command
    inputs: str  #: sensors that the method uses; "-": not specified
    #: fit(train, folder, seed, fallback) trains the method; for `fallback` see Cell
    fit: Callable[[pathlib.Path, pathlib.Path, int, bool], Predict]
    folder: pathlib.Path = pathlib.Path()  #: folder of the code of a user's method
    #: finds the files of this code; for a class, those that are loaded at the call
    find: Callable[[], Iterable[pathlib.Path]] = tuple
    #: whether predict() also receives the ground-truth maps (class attribute `oracle`)
    oracle: bool = False

    @property
    def name(self) -> str:
        """Name on the command line: MODEL, or MODEL:INPUTS if the inputs are not the default."""
        return self.model if self.inputs in ("fused", "-") else f"{self.model}:{self.inputs}"

    @property
    def is_user_method(self) -> bool:
        """Whether the method is a Python class or a command provided by the user."""
        return self.inputs == "-" and self.model not in CONSTANT

    def files(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """Returns the hash of each file of the code, or of the named files, by its path relative to
        `folder`."""
        paths = self.find() if names is None else (self.folder / name for name in names)
        found = {}
        for path in filter(pathlib.Path.is_file, sorted(paths)):
            facts = path.stat()
            found[os.path.relpath(path, self.folder)] = hashlib.sha256(
                path.read_bytes() if facts.st_size <= MAX_HASHED else
                f"{facts.st_size} {facts.st_mtime_ns}".encode()).hexdigest()[:12]
        return found

    @property
    def is_blind(self) -> bool:
        """Whether predict() receives a copy of the test run without the ground-truth maps."""
        return self.is_user_method and not self.oracle

    def test_input(self, test: pathlib.Path, folder: pathlib.Path) -> pathlib.Path:
        """Returns the run to pass to predict(): the test run or, if the method is blind, a copy
        without the ground-truth maps."""
        if not self.is_blind:
            return test
        return derive.copy(test, folder / "test.sqlite", derive.lost("depth"))


def is_code(path: pathlib.Path, folder: pathlib.Path) -> bool:
    """Returns whether a file in a folder may belong to the code of a method. Hidden files, caches,
    installed packages and data do not."""
    return path.is_relative_to(folder) and path.suffix not in DATA and not any(
        part.startswith((".", "__pycache__")) or part in PACKAGES
        for part in path.relative_to(folder).parts)


def files_of_command(words: Iterable[str]) -> list[pathlib.Path]:
    """Returns the given files, and the code below their folders. Folders of system programs are
    left out."""
    given = [pathlib.Path(word).resolve() for word in words if os.path.isfile(word)]
    system = [pathlib.Path(folder).resolve() for folder in os.get_exec_path()]
    return [*given, *(path for folder in {path.parent for path in given} - {*system}
                      for path in folder.rglob("*") if is_code(path, folder))]


def loaded_files(folder: pathlib.Path) -> set[pathlib.Path]:
    """Returns the files of all modules that were loaded from a folder."""
    return {path for module in list(sys.modules.values()) if is_code(
        path := pathlib.Path(getattr(module, "__file__", None) or "/").resolve(), folder)}


def method(text: str) -> Method:
    """Returns the method with the given name; `echofuse-bench --help` describes the valid names.
    Raises UsageError if the class cannot be imported."""
    if "/" in text:
        paths = files_of_command(shlex.split(text))
        return Method(text, "-", lambda train, folder, seed, fallback:
                      _by_command(text, train, seed), next(iter(paths), pathlib.Path()).parent,
                      lambda: paths)
    module, _, name = text.partition(":")
    if "." in module or name[:1].isupper():
        try:
            make = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError) as error:
            raise UsageError(f"method {text}: {error}") from error
        return python_method(text, make)
    inputs = "-" if module in CONSTANT and not name else name or "fused"
    return Method(module, inputs, lambda train, folder, seed,
                  fallback: _by_candidate(module, inputs, train, folder, seed, fallback))


def python_method(name: str, make: Callable[..., Fitted]) -> Method:
    """Returns a method with the given name. `make` returns a Fitted object; it is called as
    make(seed=...) or, if it has no such parameter, as make()."""
    # An installed package is a folder of its own; other modules share the folder in sys.path.
    top = sys.modules.get(getattr(make, "__module__", "").partition(".")[0])
    place = next(iter(getattr(top, "__path__", ())), getattr(top, "__file__", None))
    folder = pathlib.Path(place or "/nowhere").resolve()
    if folder.parent.name not in PACKAGES:
        folder = folder.parent
    return Method(name, "-", lambda train, scratch, seed, fallback: _by_object(make, train, seed),
                  folder, lambda: loaded_files(folder) if place else (),
                  bool(getattr(make, "oracle", False)))


def _by_candidate(model: str, inputs: str, train: pathlib.Path, folder: pathlib.Path, seed: int,
                  fallback: bool) -> Predict:
    out = folder / "model.safetensors"
    words = ["--inputs", inputs] if inputs not in ("fused", "-") else []
    call("echofuse-recon", "-q", "train", train, "--model", model, *words, "--seed", seed, "--set",
         "test_share=0", "--set", f"fallback={'true' if fallback else 'false'}", "--out", out)
    return lambda test, scratch: ([str(out)], {})


def _by_object(make: Callable[..., Fitted], train: pathlib.Path, seed: int) -> Predict:
    try:
        inspect.signature(make).bind(seed=seed)
    except (TypeError, ValueError):  # `make` has no parameter `seed`, or no signature
        fitted = make()
    else:
        fitted = make(seed=seed)
    with runs.open(train) as train_run:
        started = time.perf_counter()
        # "fused-profile" also accepts records without antenna samples.
        inputs = usual_inputs(train_run).replace("fused", "fused-profile")
        rows = split(train_run, inputs=inputs, test_share=0, validation_share=0).train
        fitted.fit(train_run, rows)
        train_s = time.perf_counter() - started

    def predict(test: pathlib.Path, folder: pathlib.Path) -> tuple[list[str], Row]:
        with runs.open(test) as test_run:
            maps, us = timed_predict(fitted, test_run)
            if maps.ndim != 3 or len(maps) != len(test_run) or maps.shape[1] != maps.shape[2]:
                raise ProgramError(f"{type(fitted).__name__}.predict returned shape {maps.shape} "
                                   f"(expected [{len(test_run)}, N, N])")
            save_maps(folder / "maps", maps, test_run.index)
            costs = {"train_s": train_s, "infer_us_batch": us / max(len(test_run), 1)}
            return ["--maps", str(folder / "maps")], costs | single_record_times(fitted, test_run)

    return predict


def timed_predict(fitted: Fitted, run: runs.Run) -> tuple[NDArray[np.float32], float]:
    """Returns the maps [n, N, N] and the total time taken to predict them, us. The time excludes
    reading the sensor data."""
    for sensor, valid in run.valid.items():
        if valid.any():
            getattr(run, sensor)  # loads the sensor data into memory
    started = time.perf_counter()
    maps = np.asarray(plain("maps", fitted.predict(run))[0], np.float32)
    return maps, 1e6 * (time.perf_counter() - started)


def single_record_times(fitted: Fitted, run: runs.Run, max_records: int = 30) -> Row:
    """Returns the median and the 99th percentile of the time taken to predict a single record, us.
    Returns an empty row if the method does not accept single records."""
    rows = np.unique(np.linspace(0, len(run) - 1, min(len(run), max_records)).astype(int)).tolist()
    try:
        us = [timed_predict(fitted, run[row:row + 1])[1] for row in rows]
    except Exception:  # noqa: BLE001 (user code)
        us = []
    return {"infer_us_median": np.median(us), "infer_us_p99": np.quantile(us, 0.99)} if us else {}


def _by_command(text: str, train: pathlib.Path, seed: int) -> Predict:
    def predict(test: pathlib.Path, folder: pathlib.Path) -> tuple[list[str], Row]:
        started = time.perf_counter()
        done = subprocess.run([*shlex.split(text), train, test, folder / "maps"],
                              capture_output=True, text=True,
                              env=os.environ | {"ECHOFUSE_SEED": str(seed)}, check=False)
        if done.returncode:
            error = ProgramError(
                f"{text}: {(done.stderr.strip().splitlines() or ['no error message'])[-1]}")
            error.add_note(done.stderr.strip())
            raise error
        # `evaluate` requires maps of the original run, so run.txt must not identify the copy.
        named = folder / "maps/run.txt"
        if named.exists() and named.read_text().startswith(runs.open(test).info["uuid"]):
            named.unlink()
        return ["--maps", str(folder / "maps")], {"train_s": time.perf_counter() - started}

    return predict


def evaluate(predict: Predict, train: pathlib.Path, test: pathlib.Path,
             test_input: pathlib.Path) -> tuple[Row, list[Row]]:
    """Returns the mean metrics and costs, and the scores of each record. `test_input` is the result
    of Method.test_input(). For a model, `echofuse-recon` reports the costs. For a Python class, the
    prediction time is the duration of predict() with the sensor data already in memory."""
    with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
        words, costs = predict(test_input, pathlib.Path(scratch))
        scores = pathlib.Path(scratch, "records.csv")
        report = json.loads(call("echofuse-recon", "-q", "evaluate", *words, test, "--train", train,
                               "--json", "--per-record", scores).stdout)
        with open(scores, newline="", encoding="utf-8") as lines:
            records = [{name: line[name] for name in ("record", *RECORDED)}
                       for line in csv.DictReader(lines)]
    row: Row = {name: nan_if_none(report["metrics"].get(name, {}).get("mean")) for name in METRICS}
    counts = {"answered": report.get("answered", report["records"]), "records": report["records"],
              "depth_maps": report["metrics"]["depth_mae_m"]["maps"],
              "threads": 1 if report.get("cost")  # echofuse-recon measures costs with one thread
              else int(os.environ.get("OMP_NUM_THREADS") or os.cpu_count() or 1)}
    if "answered" not in report:  # `records` excludes records without a predicted map
        counts["records"] += report["left_out"]
    cost = costs | (report.get("cost") or {})
    return row | counts | {name: nan_if_none(cost.get(name)) for name in COSTS}, records


def measure(method: Method, train: Path, test: Path, seed: int = 1) -> Row:
    """Trains the method on the run `train`. Returns the mean metrics and the costs measured on the
    run `test`."""
    train, test = pathlib.Path(train).resolve(), pathlib.Path(test).resolve()
    with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
        folder = pathlib.Path(scratch)
        return evaluate(method.fit(train, folder, seed, True), train, test,
                        method.test_input(test, folder))[0]


def nan_if_none(value: float | None) -> float:
    return float("nan") if value is None else float(value)
