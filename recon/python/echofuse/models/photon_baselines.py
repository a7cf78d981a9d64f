# SPDX-License-Identifier: MIT
"""Bench methods for a detector with zones. They use no network, and predict the mean training map,
the mean test map (oracle), or the first return of each zone."""
from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..runs import PS_PER_M, zones

__all__ = ["FirstReturn", "MeanMap", "OwnMeanMap"]

Maps = NDArray[np.float32]
MIN_PEAK = 0.08  # minimum height of a peak, relative to the highest bin of the zone
TABLE_M = 0.035  # minimum distance between an object and the farthest return (the table), m


def mean_map(maps: Maps) -> Maps:
    """Returns the mean depth [N, N] of the returns in each pixel; NaN if more than half of the maps
    have no return there."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # pixels may have no returns
        return np.where(np.isfinite(maps).mean(0) >= 0.5, np.nanmean(maps, 0),
                        np.nan).astype(np.float32)


class MeanMap:
    """Predicts the mean training map."""

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None:
        self.map = mean_map(run.maps()[rows])

    def predict(self, run: runs.Run) -> Maps:
        return np.repeat(self.map[None], len(run), 0)


class OwnMeanMap:
    """Predicts the mean map of the test records (oracle)."""

    oracle = True

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None:
        pass

    def predict(self, run: runs.Run) -> Maps:
        return np.repeat(mean_map(run.maps())[None], len(run), 0)


class FirstReturn:
    """Assigns each pixel to the zone with the nearest centre, without training. The pixel gets the
    depth of the first return of this zone if most of the light in the zone comes from objects in
    front of the table."""

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None:
        self.size = run.maps().shape[1]

    def predict(self, run: runs.Run) -> Maps:
        axis, half = run.axes["spd"], run.axes["map_x"].step * self.size / 2
        range_m = (axis.start + axis.step * (np.arange(axis.count) + 0.5)) / PS_PER_M
        at = half * ((2 * np.arange(self.size) + 1) / self.size - 1)
        x, y = np.meshgrid(at, -at)
        centres = zones.directions(run)
        nearest = np.argmin([(x - cx) ** 2 + (y - cy) ** 2 for cx, cy, _ in centres], 0)
        depth = np.array([self.depths(record, range_m) for record in run.photons()])
        return np.asarray(depth[:, nearest] / np.sqrt(1 + x**2 + y**2), np.float32)

    @staticmethod
    def depths(record: NDArray[np.float32], range_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the range of the object in each zone [zones], m, from counts [zones, bins]; NaN
        if the zone contains no object."""
        found = [peaks(zone, range_m) for zone in record]
        table_m = max((returns[-1][0] for returns in found if returns), default=0.0)
        out = np.full(len(found), np.nan)
        for k, returns in enumerate(found):
            near = [(r, light) for r, light in returns if r < table_m - TABLE_M]
            if near and sum(light for _, light in near) > 0.5 * sum(light for _, light in returns):
                out[k] = near[0][0]
        return out


def peaks(counts: NDArray[np.float32], range_m: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Returns the range, m, and the relative light (counts x range^2) of each return, nearest
    first."""
    h = np.maximum(counts - np.median(counts), 0)
    out = []
    for b in np.flatnonzero((h[1:-1] >= h[:-2]) & (h[1:-1] > h[2:])) + 1:
        rises = h[b] > 1.3 * max(float(h[max(b - 3, 0):b].min()), 1e-9)
        if h[b] < MIN_PEAK * h.max() or not rises or range_m[b] <= 0:
            continue
        bend = h[b - 1] - 2 * h[b] + h[b + 1]
        away = 0.5 * (h[b - 1] - h[b + 1]) / bend if bend < 0 else 0.0
        r = float(range_m[b] + away * (range_m[1] - range_m[0]))
        out.append((r, float(h[b]) * r * r))
    return out
