# SPDX-License-Identifier: MIT
"""Bench methods for a detector with zones. They use no network, and predict the mean training map,
the mean test map (oracle), an object in all pixels, or the first return of each zone."""
from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..runs import PS_PER_M, zones

__all__ = ["AllForeground", "FirstReturn", "MeanMap", "OpenFirstReturn", "OwnMeanMap",
           "interpolation", "peaks", "refined", "smooth"]

Maps = NDArray[np.float32]
Ranges = NDArray[np.float64]
MIN_PEAK = 0.08  # minimum height of a peak, relative to the highest bin of the zone
FIRST_PEAK = 0.3  # minimum height of the first return, relative to the highest bin of the zone
BRIGHT = 0.3  # minimum height of an object, relative to the 95th percentile of the record
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


class AllForeground:
    """Predicts the median depth of the objects in the training maps, in all pixels."""

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None:
        maps = run.maps()[rows]
        self.map = np.full(maps.shape[1:], np.nanmedian(maps), np.float32)

    def predict(self, run: runs.Run) -> Maps:
        return np.repeat(self.map[None], len(run), 0)


class FirstReturn:
    """Interpolates the depth of the first return and the share of the light that comes from objects
    in front of the table between the centres of the zones, without training. A pixel shows an
    object if this share is above one half."""

    def fit(self, run: runs.Run, rows: NDArray[np.int64]) -> None:
        self.size = run.maps().shape[1]

    def predict(self, run: runs.Run) -> Maps:
        axis, half = run.axes["spd"], run.axes["map_x"].step * self.size / 2
        range_m = (axis.start + axis.step * (np.arange(axis.count) + 0.5)) / PS_PER_M
        at = half * ((2 * np.arange(self.size) + 1) / self.size - 1)
        x, y = np.meshgrid(at, -at)
        weights = interpolation(zones.directions(run)[:, :2], x, y)
        return np.array([self.map_of(*self.objects(record, range_m), weights)
                         / np.sqrt(1 + x**2 + y**2) for record in run.photons()], np.float32)

    @staticmethod
    def map_of(ranges: Ranges, shares: Ranges, weights: Ranges) -> Ranges:
        """Returns the ranges in all pixels, m; NaN without an object."""
        seen = np.where(np.isfinite(ranges), weights * shares, 0)
        total = seen.sum(-1)
        depth = (seen * np.nan_to_num(ranges)).sum(-1) / np.where(total > 0, total, 1)
        return np.where((weights * shares).sum(-1) > 0.5, depth, np.nan)

    @staticmethod
    def objects(record: NDArray[np.float32], range_m: Ranges) -> tuple[Ranges, Ranges]:
        """Returns the range of the object in each zone [zones], m, and its share of the light, from
        counts [zones, bins]. A zone without an object has NaN and 0."""
        found = [peaks(zone, range_m) for zone in record]
        table_m = max((returns[-1][0] for returns in found if returns), default=0.0)
        ranges, shares = np.full(len(found), np.nan), np.zeros(len(found))
        for k, returns in enumerate(found):
            near = [(r, light) for r, light in returns if r < table_m - TABLE_M]
            if near:
                ranges[k] = near[0][0]
                shares[k] = sum(light for _, light in near) / sum(light for _, light in returns)
        return ranges, shares


class OpenFirstReturn(FirstReturn):
    """Interpolates the first return in scenes without a table or a wall. A pixel shows an object if
    the interpolated height of the highest peak is above BRIGHT, relative to the 95th percentile of
    the zones."""

    @staticmethod
    def objects(record: NDArray[Any], range_m: Ranges) -> tuple[Ranges, Ranges]:
        h = smooth(np.asarray(record, float))
        h -= np.median(h, -1, keepdims=True)
        top = h.max(-1)
        is_peak = np.zeros(h.shape, bool)
        is_peak[:, 1:-1] = ((h[:, 1:-1] >= h[:, :-2]) & (h[:, 1:-1] > h[:, 2:])
                            & (h[:, 1:-1] > FIRST_PEAK * top[:, None]))
        at = np.where(is_peak.any(-1), is_peak.argmax(-1), np.clip(h.argmax(-1), 1, h.shape[1] - 2))
        ranges = range_m[0] + (range_m[1] - range_m[0]) * refined(h, at)
        return ranges, 0.5 * top / max(BRIGHT * float(np.percentile(top, 95)), 1e-9)


def smooth(counts: Ranges) -> Ranges:
    out = counts.copy()
    out[..., 1:-1] = (counts[..., :-2] + 2 * counts[..., 1:-1] + counts[..., 2:]) / 4
    return out


def refined(h: Ranges, at: NDArray[np.integer[Any]]) -> Ranges:
    """Returns the vertex, in bins, of the parabola through the bin `at` and its neighbours."""
    low, top, high = (np.take_along_axis(h, at[..., None] + k, -1)[..., 0] for k in (-1, 0, 1))
    bend = low - 2 * top + high
    return np.asarray(at + np.where(bend < 0, 0.5 * (low - high) / np.where(bend < 0, bend, 1), 0))


def interpolation(centres: Ranges, x: Ranges, y: Ranges) -> Ranges:
    """Returns the weight of each zone in each pixel [..., zones], for bilinear interpolation
    between the centres [zones, 2] of a square of zones. Outside of the centres, the nearest ones
    count."""
    side = max(round(len(centres) ** 0.5), 2)
    out, away = np.ones((*x.shape, len(centres))), np.zeros((*x.shape, len(centres)))
    for at, place in zip(centres.T, (x, y)):
        step = np.abs(np.clip(place, at.min(), at.max())[..., None] - at)
        out *= np.maximum(1 - step / max(float(np.ptp(at)) / (side - 1), 1e-9), 0)
        away += step**2
    out += 1e-9 / (away + 1e-9)  # a pixel between displaced centres gets the nearest zone
    return np.asarray(out / out.sum(-1, keepdims=True))


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
