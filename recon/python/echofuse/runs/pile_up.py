# SPDX-License-Identifier: MIT
"""Corrects the counts of a detector with dead time for pile-up, by the method of Coates
(recon/data/pile_up.hpp)."""
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["corrected"]


def corrected(run: Any, counts: NDArray[np.float32], clicks: float,
              clicks_per_pulse: float) -> NDArray[np.float32]:
    """Corrects the counts [bins] of one record for pile-up. `clicks` is the number of clicks in the
    record. If clicks_per_pulse is 0 (unknown), or the dead time of the run is not a positive
    number, the counts are returned unchanged."""
    text = run.meta["detector_dead_time_ps"]
    try:
        dead_ps = np.inf if text == "until the next pulse" else float(text)
    except ValueError:
        dead_ps = 0.0
    if not (clicks_per_pulse > 0 and (0 < dead_ps <= 1e12 or dead_ps == np.inf)):
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
