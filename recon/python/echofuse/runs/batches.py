# SPDX-License-Identifier: MIT
"""Reads a long run in blocks and marks unreadable records."""
from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import antennas
from .run import Run

__all__ = ["Progress", "blocks", "load", "marked"]

MAX_RECORDS, MAX_BYTES = 256, 32 << 20  # maximum number of records and bytes in a block
Progress = Callable[[int], None]  # function called with the number of finished records


def load(part: Run) -> None:
    """Loads the arrays of all valid sensors. Raises ValueError at the first unreadable record."""
    for name in (name for name, mask in part.valid.items() if mask.any()):
        getattr(part, name)  # reads and caches the array
    if not part.valid["radar"].any():
        return
    for row, bin_ in np.argwhere(~np.isfinite(part.radar) & part.valid["radar"][:, None])[:1]:
        raise ValueError(
            f"{part.path}: record {part.index[row]}: radar bin {bin_} is not a finite number")
    if "array" in part.axes:
        antennas.values(part)


def blocks(run: Run, progress: Progress = lambda done: None
           ) -> Iterator[tuple[int, Run, dict[int, str]]]:
    """For each block, yields the number of its first row, a run with its records, and the error
    messages of its unreadable rows. Unreadable records are marked as records without a valid
    sensor."""
    count = {name: axis.count for name, axis in run.axes.items()}
    count["spd"] = count.get("spd", 0) * (len(run.zones) or 1)
    size = sum(count.get(name, 0)
               for name in ("spd", "radar")) + 2 * count.get("depth_x", 0) * count.get("depth_y", 0)
    size += count["array"] * (int(run.axes["array"].scale) + 1) ** 2 if "array" in count else 0
    step = min(max(MAX_BYTES // (4 * size + 1), 1), MAX_RECORDS)
    for first in range(0, max(len(run), 1), step):
        progress(first)
        part, faults = run[first:first + step], {}
        try:
            load(part)
        except ValueError:
            part = run[first:first + step]
            for row in range(len(part)):
                try:
                    load(part[row:row + 1])
                except ValueError as error:
                    faults[row] = "unreadable: " + re.sub(r".*record \d+: ", "", str(error))
                    for mask in part.valid.values():
                        mask[row] = False
        yield first, part, faults
    progress(len(run))


def marked(verdicts: NDArray[Any], faults: dict[int, Any]) -> list[Any]:
    """Replaces the verdicts of unreadable rows with their error messages."""
    return list((dict(enumerate(verdicts.tolist())) | faults).values())
