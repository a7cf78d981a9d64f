# SPDX-License-Identifier: MIT
"""Corrects the counts of a detector with dead time for pile-up, by the method of Coates
(recon/data/pile_up.hpp)."""
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .run_files import numbers_in, reals

__all__ = ["clicks_of", "corrected"]


def clicks_of(run: Any) -> list[tuple[float, float]]:
    """For each record, returns its clicks, and its clicks per laser pulse (0: unknown)."""
    rows = run.of_records(f"{reals(in_range=0, out_of_range=0, starts=0)}, "
                          "CAST(clicks_per_pulse AS REAL)")
    return [(a + b, known if known is not None else (a + b) / starts
             if a + b < 0.95 * starts else 0.0) for a, b, starts, known in rows]


def corrected(run: Any, counts: NDArray[np.float32], clicks: float,
              clicks_per_pulse: float) -> NDArray[np.float32]:
    """Corrects the counts [bins] of one record for pile-up. `clicks` is the number of clicks in the
    record. The counts are returned unchanged if clicks_per_pulse is 0 (unknown), or if the dead
    time or the slot length of the run is not a positive number."""
    text = run.meta["detector_dead_time_ps"]
    numbers = [np.inf] if text == "until the next pulse" else numbers_in(text)
    dead_ps = numbers[0] if len(numbers) == 1 else 0.0
    if not (clicks > 0 and clicks_per_pulse > 0 and (0 < dead_ps <= 1e12 or dead_ps == np.inf)
            and 0 < run.info["window_s"] <= 1e6 and run.axes["spd"].unit == "ps"):
        return counts
    pulses, width = clicks / clicks_per_pulse, run.axes["spd"].step
    dead = dead_ps / width
    before = np.concatenate([[0], np.cumsum(counts, dtype=np.float64)])
    places = np.arange(len(before))
    period = 1e12 * run.info["window_s"] / pulses / width
    whole = 0 if np.isinf(dead) else np.floor(dead / period)
    since = np.arange(len(counts)) + 0.5 - (dead - whole * period)
    blocked = before[:-1] - np.minimum(np.interp(since, places, before),
                                       before[:-1]) + whole * before[-1]
    if not np.isinf(dead):
        blocked += before[-1] - np.interp(since + period, places, before)
    ready = np.maximum(pulses - blocked, counts + 0.5)
    return np.asarray(-pulses * np.log1p(-counts / ready), np.float32)
