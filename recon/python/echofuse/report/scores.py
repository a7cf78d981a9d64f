# SPDX-License-Identifier: MIT
"""Scores of the models of a report, by `echofuse-recon evaluate`."""
from __future__ import annotations

import csv
import json
import pathlib
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bench.methods import nan_if_none
from ..models.model import read_safetensors
from ..runs.programs import BenchError, call

Values = NDArray[np.float64]


class ReportError(BenchError):
    """One line that says what was wrong, and the exit code."""


class Mean(NamedTuple):
    mean: float = np.nan
    se: float = np.nan  # standard error; NaN of fewer than two
    maps: int = 0  # that define it

    @classmethod
    def of(cls, values: Values) -> Mean:
        known = values[~np.isnan(values)]
        return cls(known.mean(), known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 1
                   else np.nan, len(known)) if len(known) else cls()


class Means(dict[str, Mean]):
    """By metric; NaN of what is not defined."""

    def __missing__(self, metric: str) -> Mean:
        return Mean()


def means_of(told: dict[str, Any]) -> Means:
    return Means({name: Mean(nan_if_none(m["mean"]), nan_if_none(m["se"]), m["maps"])
                  for name, m in told.items()})


@dataclass(frozen=True)
class Count:
    count: int
    of: int

    def __str__(self) -> str:
        return f"{self.count} of {self.of}"

    @property
    def interval(self) -> tuple[float, float]:
        """95 % (Wilson 1927)."""
        if self.of == 0:
            return 0, 1
        z, n, p = 1.96, self.of, self.count / self.of
        middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return max(0, (middle - half) / (1 + z * z / n)), min(1, (middle + half) / (1 + z * z / n))

    @classmethod
    def where(cls, holds: NDArray[np.bool_], *known: Values) -> Count:
        """Counts the records of which all these values are known."""
        there = ~np.isnan(np.array(known)).any(0)
        return cls(int(holds[there].sum()), int(there.sum()))


@dataclass
class Scores:
    """One model on the records of a run: the JSON of `evaluate`, and columns [n] of its table of
    records."""

    told: dict[str, Any]
    index: NDArray[np.int64]
    labels: list[str]
    warnings: list[str]  # warnings of the model: out of distribution
    columns: dict[str, Values]

    def __getitem__(self, name: str) -> Values:
        return self.columns[name] if name in self.columns else np.full(len(self.index), np.nan)

    @property
    def shift(self) -> dict[str, Any]:
        """Test of the run as a whole: p, records, found, text; empty if it was not tested."""
        return self.told.get("domain_shift") or {}

    @property
    def remarks(self) -> list[str]:
        """Sentences of `evaluate` that are no failure: a run like the training, assumptions."""
        found = [*(self.told.get(key) for key in ("note", "antennas", "response", "ranges")),
                 self.told.get("two_people", {}).get("text")]
        return [text for text in ("" if self.shift.get("found") else self.shift.get("text"),
                                  *found) if text]

    @property
    def notes(self) -> list[str]:
        """All other sentences of `evaluate`: records left out, a truth that contradicts the
        sensors."""
        told = [self.shift.get("text"), *self.remarks]
        return [line for line in self.told["notes"].splitlines() if line not in told]

    @property
    def kept(self) -> Count:
        """Bodies within what was stated."""
        off, stated = self["lateral_m"], self["lateral_interval_90_m"]
        return Count.where(off <= stated, off, stated)

    @property
    def outside(self) -> str:
        """Bodies outside the stated interval, against 10 % expected; empty if none is stated."""
        kept, off, stated = self.kept, self["lateral_m"], self["lateral_interval_90_m"]
        if not kept.of:
            return ""
        worst = int(np.nanargmax(off / stated))
        return (f"{kept.of - kept.count} of {kept.of} bodies are outside the stated 90 % interval, "
                f"{0.1 * kept.of:.0f} expected; worst: record {self.index[worst]}, "
                f"{100 * off[worst]:.0f} cm off to the side, stated within "
                f"{100 * stated[worst]:.0f} cm")

    @property
    def order(self) -> list[int]:
        """Indices of the records, the worst IoU first."""
        return list(self.index[np.argsort(np.nan_to_num(self["iou"]), kind="stable")].tolist())


class Judged(NamedTuple):
    """Scores of models on a run, by `evaluate`."""

    scores: list[Scores]
    told: dict[str, Any]
    said: str  # about another room

    def span(self, wall: float, far_m: float) -> tuple[float, float]:
        """Depths of the maps with a margin: one scale for all. wall: the background's farthest
        depth."""
        body = float(self.told["foreground_depth_m"])
        near = max(0.0, float(np.floor(2 * (body - 1)) / 2))
        return near, float(np.clip(np.ceil(2 * max(body + 1, wall)) / 2, near + 1,
                                   max(near + 1, far_m)))


def evaluated(models: Sequence[str], run: str, room: Sequence[str],
              folders: Sequence[str] = ()) -> Judged:
    """Models judged together, on the records with every sensor that one of them asks for; with
    folders of maps these first. room: [] or ["--empty", RUN]."""
    words = [*models, run, *room, *(word for folder in folders for word in ("--maps", folder))]
    with tempfile.TemporaryDirectory(prefix="echofuse-report-") as folder:
        out = pathlib.Path(folder) / "records.csv"
        done = call("echofuse-recon", "-q", "evaluate", *words, "--json", "--per-record", out,
                    ok=(0, 5))
        told = json.loads(done.stdout)
        with open(out, newline="", encoding="utf-8") as file:
            lines = list(csv.DictReader(file))
    scores, first, texts = [], 0, ("record", "label", "name", "out_of_distribution")
    for row in told.get("rows", [told]):
        some = lines[first:first + row.get("records", told["records"])]
        first += len(some)
        scores.append(Scores(row, np.array([line["record"] for line in some], np.int64),
                             [line["label"] for line in some],
                             [line["out_of_distribution"] for line in some],
                             {name: np.array([line[name] or "nan" for line in some], float)
                              for name in lines[0] if name not in texts}))
    return Judged(scores, told, " ".join(done.stderr.split("\n")).strip())


@dataclass
class Mode:
    """A model of the report, perhaps of several trainings; the first one is shown."""

    name: str
    files: list[str]
    facts: list[dict[str, Any]]  # facts of each file
    tensors: dict[str, NDArray[Any]]  # tensors of the first file
    takes: str  # "SPD + 8 antennas", "SPD alone"; "no sensor" of a constant map
    scores: list[Scores] = field(default_factory=list)
    # to the report's first, by metric
    differences: dict[str, dict[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.short = self.name.rpartition("/")[2]
        self.inputs = str(self.facts[0]["0/inputs"])
        self.both = self.inputs.startswith("fused")
        self.papers = (self.facts[0]["0/model"] == "mlp"
                       and self.tensors["0/training/hidden"].tolist() == [512, 256])

    @property
    def first(self) -> Scores:
        return self.scores[0]

    @property
    def title(self) -> str:
        kind = "the paper's network" if self.papers else self.facts[0]["0/model"]
        seeds = f"; {len(self.files)} trainings" if len(self.files) > 1 else ""
        return f"{self.short} ({'' if kind == self.short else kind + ', '}{self.takes}{seeds})"

    @property
    def means(self) -> Means:
        """As evaluated; of several trainings mean and standard error over these: the spread is the
        honest error."""
        all_means = [means_of(s.told["metrics"]) for s in self.scores]
        return all_means[0] if len(all_means) == 1 else Means(
            {m: Mean.of(np.array([one[m].mean for one in all_means])) for m in all_means[0]})


def takes_of(facts: dict[str, Any]) -> str:
    if facts["0/model"] in ("mean", "empty"):
        return "no sensor"
    if not facts["0/inputs"].startswith("fused"):
        return {"spd": "SPD alone", "radar": "radar alone"}[facts["0/inputs"]]
    if not facts["0/takes_antennas"]:
        return "SPD + radar profile"
    # A row without gaps tells the number of antennas.
    return (f"SPD + {facts['0/axes/array/scale'] + 1:.0f} antennas"
            if facts["0/axes/array/quantity"] == "lags" else "SPD + antennas")


def modes_of(models: Sequence[str], compared: bool) -> list[Mode]:
    """FILE or NAME=FILE each: a seed of the mode of that name, or a mode behind the last of equal
    inputs. Compared models stay as they are given."""
    modes: list[Mode] = []
    for given in models:
        name, equals, path = given.partition("=")
        if compared or not equals or "/" in name:
            name, path = (given if compared else pathlib.Path(given).stem), given
        try:
            tensors, facts = read_safetensors(path)
        except OSError as error:
            raise ReportError(f"{path}: {error.strerror}; expected a model file") from None
        takes = takes_of(facts)
        known = next((mode for mode in modes if mode.name == name and not compared), None)
        if known is None:
            like = [k for k, mode in enumerate(modes, 1) if compared or mode.takes == takes]
            modes.insert(like[-1] if like else len(modes),
                         Mode(name, [path], [facts], tensors, takes))
        elif known.takes != takes:
            raise ReportError(
                f"{path}: takes {takes}, and {known.files[0]} of the same name {known.takes}; "
                f"expected --model NAME={path}")
        else:
            known.files.append(path)
            known.facts.append(facts)
    return modes
