# SPDX-License-Identifier: MIT
"""Splits a run into training, validation and test rows, as `echofuse-recon train` does."""
from __future__ import annotations

import json
import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arguments import ComparedByValue
from .programs import call
from .run import Run, opened

__all__ = ["Split", "split", "usual_inputs"]

Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Split(ComparedByValue):
    """Row numbers of a run in each part of a split."""

    train: Rows  #: rows for training
    validation: Rows  #: rows for early stopping
    test: Rows  #: held-out rows


def usual_inputs(run: Run) -> str:
    """Returns the ranging sensors of the run: "spd", "radar", or "fused" for both."""
    ranging = [sensor for sensor in ("spd", "radar") if run.valid[sensor].any()]
    return ranging[0] if len(ranging) == 1 else "fused"


def split(run: Run | str | pathlib.Path, kind: str = "random", seed: int = 1, *,
          inputs: str | None = None, test_share: float = 0.1, validation_share: float = 0.05,
          gap: int = 0, doubtful: str = "leave", lossy: str = "take") -> Split:
    """Returns the split computed by `echofuse-recon rows`. The split excludes incomplete records,
    records with a dead sensor and, unless `doubtful` is "take", doubtful records; lossy records
    only if `lossy` is "leave". kind: "random", or "blocked" for sequences of similar records.
    inputs: required sensors, "fused", "spd" or "radar" (default: the sensors of the run). Raises
    RuntimeError with the program's error message if the program fails."""
    run = opened(run)
    inputs = inputs or usual_inputs(run)
    settings = {"test_share": test_share, "validation_share": validation_share, "gap": gap,
                "doubtful": doubtful, "lossy": lossy}
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    run.events()  # checks that the file still contains this run
    rows = json.loads(call("echofuse-recon", "-q", "rows", run.path, "--json", "--split", kind,
                           "--seed", seed, "--inputs", inputs, *words).stdout)["records"]
    part_of = {record["record"]: record.get("part") for record in rows}
    parts = np.array([part_of.get(index) or "" for index in run.index.tolist()], str)
    return Split(*(np.flatnonzero(parts == part) for part in ("train", "validation", "test")))
