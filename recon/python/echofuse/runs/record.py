# SPDX-License-Identifier: MIT
"""Reads one record of a run."""
from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .run import Run

__all__ = ["Record"]


@dataclass(frozen=True)
class Record:
    """One record of a run, e.g. run[3]. Each access reads the file, except for arrays that the run
    has cached, and in an iteration over the run."""

    run: Run  #: run that contains the record
    row: int  #: row in the arrays of the run

    @property
    def index(self) -> int:
        """Number of the record in the run file."""
        return int(self.run.index[self.row])

    @property
    def label(self) -> str:
        """Label set by the operator; may be empty."""
        return self.run.labels[self.row]

    @property
    def time(self) -> np.datetime64:
        """Start of the slot, UTC."""
        return np.datetime64(self.run.time[self.row])

    @property
    def spd(self) -> NDArray[np.uint32]:
        """Counts [bins], or [zones, bins] for a detector with zones."""
        return np.asarray(self.run.of_row("spd", self.row))

    @property
    def radar(self) -> NDArray[np.float32]:
        """Linear power [points]."""
        return np.asarray(self.run.of_row("radar", self.row))

    @property
    def depth(self) -> NDArray[np.float32]:
        """z of each pixel of the camera image [rows, columns], m; NaN: no return."""
        return np.asarray(self.run.of_row("depth", self.row))

    def __repr__(self) -> str:
        valid = ", ".join(name for name, mask in self.run.valid.items()
                          if mask[self.row]) or "no sensor"
        return f"<record {self.index} of {self.run.path.name}: {valid}; {self.label or 'no label'}>"
