# SPDX-License-Identifier: MIT
"""One record of a run."""
from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .run import Run


@dataclass(frozen=True)
class Record:
    """One record of a run: run[3]. Its depth image is read when it is asked for."""

    run: Run
    row: int

    @property
    def index(self) -> int:
        return int(self.run.index[self.row])

    @property
    def label(self) -> str:
        return self.run.labels[self.row]

    @property
    def time(self) -> np.datetime64:
        return np.datetime64(self.run.time[self.row])

    @property
    def spd(self) -> NDArray[np.uint32]:
        """Counts [bins]."""
        return np.asarray(self.run.spd[self.row])

    @property
    def radar(self) -> NDArray[np.float32]:
        """Linear power [points]."""
        return np.asarray(self.run.radar[self.row])

    @property
    def depth(self) -> NDArray[np.float32]:
        """z in metres [rows, columns] of the camera's image, NaN: no return."""
        image = self.run.depth_mm(self.row)
        return np.where(image > 0, image / np.float32(1000), np.float32(np.nan))

    def __repr__(self) -> str:
        valid = ", ".join(name for name, mask in self.run.valid.items() if mask[self.row]) or "no sensor"
        return f"<record {self.index} of {self.run.path.name}: {valid}; {self.label or 'no label'}>"
