# SPDX-License-Identifier: MIT
"""Scores the models of a report with `echofuse-recon evaluate`."""
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
from ..runs.programs import ProgramError, call

__all__ = ["Count", "Evaluation", "Mean", "Means", "ReportError", "ReportModel", "Scores",
           "Values", "evaluate", "lines_of", "means_of", "read_models", "sensors_of"]

Values = NDArray[np.float64]
NAMES = ("inputs", "model", "name", "schema")  # strings in the output of `evaluate` that are names


class ReportError(ProgramError):
    """Error of echofuse-report, with a one-line message and an exit code."""


class Mean(NamedTuple):
    """Mean of a metric over maps."""

    mean: float = np.nan
    se: float = np.nan  # standard error; NaN for fewer than three values
    maps: int = 0  # number of maps for which the metric is defined

    @classmethod
    def of(cls, values: Values) -> Mean:
        known = values[~np.isnan(values)]
        return cls(known.mean(), known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 2
                   else np.nan, len(known)) if len(known) else cls()


class Means(dict[str, Mean]):
    """Means by metric name; NaN for a missing metric."""

    def __missing__(self, metric: str) -> Mean:
        return Mean()


def means_of(metrics: dict[str, Any]) -> Means:
    """Converts the object "metrics" in the JSON output of `evaluate` to Means."""
    return Means({name: Mean(nan_if_none(m["mean"]), nan_if_none(m["se"]), m["maps"])
                  for name, m in metrics.items()})


@dataclass(frozen=True)
class Count:
    """A number of records out of a total."""

    count: int
    total: int

    def __str__(self) -> str:
        return f"{self.count} of {self.total}"

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the fraction count / total (Wilson 1927)."""
        if self.total == 0:
            return 0, 1
        z, n, p = 1.96, self.total, self.count / self.total
        middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return max(0, (middle - half) / (1 + z * z / n)), min(1, (middle + half) / (1 + z * z / n))

    @classmethod
    def where(cls, holds: NDArray[np.bool_], *known: Values) -> Count:
        """Counts the records for which `holds` is true. Excludes records with NaN in `known`."""
        valid = ~np.isnan(np.array(known)).any(0)
        return cls(int(holds[valid].sum()), int(valid.sum()))


def lines_of(result: Any, name: str = "") -> list[str]:
    """Returns every line of text in the JSON output of `evaluate`, without repetitions."""
    if isinstance(result, dict):
        parts = [line for key, part in result.items() for line in lines_of(part, key)]
    elif isinstance(result, list):
        parts = [line for part in result for line in lines_of(part, name)]
    else:
        parts = result.splitlines() if isinstance(result, str) and name not in NAMES else []
    return list(dict.fromkeys(parts))


@dataclass
class Scores:
    """Scores of one model on the records of a run."""

    result: dict[str, Any]  # JSON output of `evaluate`
    index: NDArray[np.int64]  # record indices [n]
    labels: list[str]
    warnings: list[str]  # why each record is flagged; empty if a record is not flagged
    columns: dict[str, Values]  # per-record scores [n] by name

    def __getitem__(self, name: str) -> Values:
        return self.columns[name] if name in self.columns else np.full(len(self.index), np.nan)

    @property
    def shift(self) -> dict[str, Any]:
        """Result of the test for a difference between the run and the training data: p, records,
        found and text. Empty if the run was not tested."""
        return self.result.get("domain_shift") or {}

    @property
    def notes(self) -> list[str]:
        """Problems reported by `evaluate`, e.g. excluded records, or ground-truth maps that
        contradict the sensors."""
        known = [self.shift.get("text"), *lines_of(self.result | {"notes": "", "rows": []})]
        return [line for line in self.result["notes"].splitlines() if line not in known]

    @property
    def inside(self) -> Count:
        """Number of bodies with a lateral error within the 90 % interval predicted by the model."""
        error, stated = self["lateral_m"], self["lateral_interval_90_m"]
        return Count.where(error <= stated, error, stated)

    @property
    def outside(self) -> str:
        """Text about bodies outside the 90 % interval; empty if the model does not predict an
        interval."""
        inside, error, stated = self.inside, self["lateral_m"], self["lateral_interval_90_m"]
        if not inside.total:
            return ""
        worst = int(np.nanargmax(error / stated))
        return (f"{inside.total - inside.count} of {inside.total} bodies are outside their stated "
                f"90 % interval (expected: {0.1 * inside.total:.0f}); the worst is record "
                f"{self.index[worst]} with a lateral error of {100 * error[worst]:.0f} cm and a "
                f"stated interval of ±{100 * stated[worst]:.0f} cm")

    @property
    def order(self) -> list[int]:
        """Record indices in order of increasing IoU."""
        return list(self.index[np.argsort(np.nan_to_num(self["iou"]), kind="stable")].tolist())


class Evaluation(NamedTuple):
    """Scores of all models on a run, as computed by `evaluate`."""

    scores: list[Scores]
    result: dict[str, Any]  # JSON output of `evaluate`
    room_note: str  # stderr of `evaluate`, e.g. a warning about a different room


def evaluate(models: Sequence[str], run: str, options: Sequence[str],
             folders: Sequence[str] = ()) -> Evaluation:
    """Scores the maps in the folders, and then the models, on the records that have all required
    sensors. `options` may contain --empty and --train."""
    words = [*models, run, *options, *(word for folder in folders for word in ("--maps", folder))]
    with tempfile.TemporaryDirectory(prefix="echofuse-report-") as folder:
        out = pathlib.Path(folder) / "records.csv"
        done = call("echofuse-recon", "-q", "evaluate", *words, "--json", "--per-record", out,
                    ok=(0, 5))
        result = json.loads(done.stdout)
        with open(out, newline="", encoding="utf-8") as file:
            lines = list(csv.DictReader(file))
    scores, first, texts = [], 0, ("record", "label", "name", "out_of_distribution")
    for row in result.get("rows", [result]):
        part = lines[first:first + row.get("records", result["records"])]
        first += len(part)
        scores.append(Scores(row, np.array([line["record"] for line in part], np.int64),
                             [line["label"] for line in part],
                             [line["out_of_distribution"] for line in part],
                             {name: np.array([line[name] or "nan" for line in part], float)
                              for name in lines[0] if name not in texts}))
    return Evaluation(scores, result, " ".join(done.stderr.split("\n")).strip())


@dataclass
class ReportModel:
    """A model in the report, trained once or several times. Its maps are predicted by the first
    model file."""

    name: str
    files: list[str]
    facts: list[dict[str, Any]]  # metadata of each model file
    tensors: dict[str, NDArray[Any]]  # tensors of the first model file
    sensors: str  # names of the sensors, e.g. "SPD + 8 antennas"; "no sensor" for a constant map
    scores: list[Scores] = field(default_factory=list)
    # paired differences from the first model of the report, by metric
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
        return f"{self.short} ({'' if kind == self.short else kind + ', '}{self.sensors}{seeds})"

    @property
    def means(self) -> Means:
        """Mean and standard error of each metric over the trained models or, if the model was
        trained only once, over the maps."""
        all_means = [means_of(s.result["metrics"]) for s in self.scores]
        return all_means[0] if len(all_means) == 1 else Means(
            {m: Mean.of(np.array([means[m].mean for means in all_means]))._replace(
                maps=min(means[m].maps for means in all_means)) for m in all_means[0]})


def sensors_of(facts: dict[str, Any]) -> str:
    """Returns a text with the names of the sensors used by a model."""
    if facts["0/model"] in ("mean", "empty"):
        return "no sensor"
    if not facts["0/inputs"].startswith("fused"):
        return {"spd": "SPD alone", "radar": "radar alone"}[facts["0/inputs"]]
    if not facts["0/takes_antennas"]:
        return "SPD + radar profile"
    # The number of antennas is known only if the antennas form a row without gaps.
    return (f"SPD + {facts['0/axes/array/scale'] + 1:.0f} antennas"
            if facts["0/axes/array/quantity"] == "lags" else "SPD + antennas")


def read_models(arguments: Sequence[str], compared: bool) -> list[ReportModel]:
    """Reads models given as FILE or NAME=FILE. Files with the same name are treated as one model
    that was trained several times. Models with the same inputs are placed next to each other.
    Compared models keep their order and names."""
    models: list[ReportModel] = []
    for argument in arguments:
        name, equals, path = argument.partition("=")
        if compared or not equals or "/" in name:
            name, path = (argument if compared else pathlib.Path(argument).stem), argument
        try:
            tensors, facts = read_safetensors(path)
        except OSError as error:
            raise ReportError(f"{path}: {error.strerror}; expected a model file") from None
        sensors = sensors_of(facts)
        known = next((model for model in models if model.name == name and not compared), None)
        if known is None:
            like = [k for k, model in enumerate(models, 1) if compared or model.sensors == sensors]
            models.insert(like[-1] if like else len(models),
                         ReportModel(name, [path], [facts], tensors, sensors))
        elif known.sensors != sensors:
            raise ReportError(
                f"{path}: the model has the inputs {sensors}, but {known.files[0]} with the same "
                f"name has the inputs {known.sensors}; give --model NAME={path}")
        else:
            known.files.append(path)
            known.facts.append(facts)
    return models
