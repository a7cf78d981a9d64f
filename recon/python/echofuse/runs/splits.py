# SPDX-License-Identifier: MIT
"""The program's split of a run: the rows that `echofuse-recon train` trains on and holds out."""
from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .programs import call
from .run import Run

Rows = NDArray[np.int64]


@dataclass(frozen=True)
class Split:
    """Rows of a run, by their part in a training."""

    train: Rows  #: to fit
    validation: Rows  #: to stop early
    test: Rows  #: held out


def usual_inputs(run: Run) -> str:
    """Ranging sensors that the run has: "spd", "radar", or "fused" for both."""
    ranging = [sensor for sensor in ("spd", "radar") if run.valid[sensor].any()]
    return ranging[0] if len(ranging) == 1 else "fused"


def split(run: Run, kind: str = "random", seed: int = 1, *, inputs: str | None = None,
          test_share: float = 0.1, validation_share: float = 0.05, gap: int = 0) -> Split:
    """Rows of the run to train on, to stop early by, and to judge by, as `echofuse-recon rows`
    says them: doubtful, dead and incomplete records are in none. kind: "random", or "blocked" for
    sequences; inputs: sensors that a record needs, "fused", "spd" or "radar" (default: those of the
    run). Raises RuntimeError with the program's own line."""
    inputs = inputs or usual_inputs(run)
    settings = {"test_share": test_share, "validation_share": validation_share, "gap": gap}
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    told = json.loads(call("echofuse-recon", "-q", "rows", run.path, "--json", "--split", kind,
                           "--seed", seed, "--inputs", inputs, *words).stdout)["records"]
    part_of = {record["record"]: record.get("part") for record in told}
    parts = np.array([part_of.get(index) or "" for index in run.index.tolist()])
    return Split(*(np.flatnonzero(parts == part) for part in ("train", "validation", "test")))
