# SPDX-License-Identifier: MIT
"""Reads a long run in blocks and marks unreadable records."""
from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .run import SENSORS, Run

__all__ = ["Progress", "blocks", "load", "marked"]

COUNTS = ("starts", "in_range", "out_of_range", "array_frames")
LAST_SLOT_END_NS = (1 << 63) - 1 - 31_556_952 * 10 ** 9  # one year before the last time (2262)
MAX_RECORDS, MAX_BYTES = 256, 32 << 20  # maximum number of records and bytes in a block
Progress = Callable[[int], None]  # function called with the number of finished records


def require_facts(part: Run) -> None:
    """Raises ValueError at the first record with impossible times or counts (stored_record() in
    acquire/record/run_reader.cpp)."""
    columns = ("slot_start_ns", "slot_end_ns", "slot_utc_ns", *COUNTS)
    rows = part.of_records(", ".join(f"CAST(ifnull({name}, 0) AS INTEGER)" for name in columns)
                           + ", CAST(ifnull(clicks_per_pulse, 0) AS REAL)")
    for index, (start, end, utc, *counts, clicks) in zip(part.index.tolist(), rows):
        place = f"{part.path}: record {index}: "
        if not (0 <= start <= end and 0 <= utc <= LAST_SLOT_END_NS - (end - start)):
            raise ValueError(f"{place}its slot is from {start} to {end} ns and starts at {utc} ns "
                             "UTC; expected an end after the start, and years from 1970 to 2261")
        for name, count in zip(COUNTS, counts):
            if count < 0:
                raise ValueError(f"{place}{name} is {count}")
        if not 0 <= clicks < 1e9:
            raise ValueError(f"{place}its number of clicks per laser pulse is not from 0 to 1e9")


def load(part: Run, sensors: Collection[str] = (*SENSORS,)) -> None:
    """Loads the arrays of the given sensors. Raises ValueError at the first unreadable record."""
    require_facts(part)
    for name in (name for name in sensors if part.valid[name].any()):
        getattr(part, name)  # reads and caches the array
    if "radar" not in sensors or not part.valid["radar"].any():
        return
    for row, bin_ in np.argwhere(~np.isfinite(part.radar) & part.valid["radar"][:, None])[:1]:
        raise ValueError(
            f"{part.path}: record {part.index[row]}: radar bin {bin_} is not a finite number")
    if "array" in part.axes:
        list(part.array_bins())  # checks the samples


def blocks(run: Run, progress: Progress = lambda done: None,
           sensors: Collection[str] = (*SENSORS,)) -> Iterator[tuple[int, Run, dict[int, str]]]:
    """For each block, yields the number of its first row, a run with its records, and the error
    messages of its rows that are unreadable for the given sensors. Unreadable records are marked as
    records without a valid sensor."""
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
            load(part, sensors)
        except ValueError:
            part = run[first:first + step]
            for row in range(len(part)):
                try:
                    load(part[row:row + 1], sensors)
                except ValueError as error:
                    faults[row] = "unreadable: " + re.sub(r".*record \d+: ", "", str(error))
                    for mask in part.valid.values():
                        mask[row] = False
        yield first, part, faults
    progress(len(run))


def marked(verdicts: NDArray[Any], faults: dict[int, Any]) -> list[Any]:
    """Replaces the verdicts of unreadable rows with their error messages."""
    return list((dict(enumerate(verdicts.tolist())) | faults).values())
