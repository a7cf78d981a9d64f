# SPDX-License-Identifier: MIT
"""Converts radar profiles so that they have the radar response of the training data
(recon/data/response_conversion.cpp)."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["Response", "filter_between", "filtered", "stated_in"]

TAPS_PER_CELL = 4  # same value as in acquire/measurement/response.hpp
# same values as in recon/data/response_conversion.cpp
MIN_REACH_CELLS, MIN_POWER, MAX_REACH = 3, .01, 48
PARTS, NOISE_TO_SIGNAL, MUCH_NARROWER = 8, 1e-3, .75


@dataclass(frozen=True)
class Response:
    """Radar response: relative power at each distance from the peak."""

    cell_m: float
    # relative power towards larger ranges; the response is symmetric if the first tap is the peak
    taps: tuple[float, ...]

    def peak(self) -> int:
        """Returns the index of the tap at the peak; 0 for a symmetric response."""
        return 0 if abs(self.taps[0] - 1) < 1e-3 else int(np.argmax(self.taps))

    def extent_m(self) -> float:
        """Returns the distance from the peak at which the power last exceeds 1 % of the peak, m."""
        high = np.flatnonzero(np.array(self.taps) > MIN_POWER)
        return float(abs(high - self.peak()).max() / TAPS_PER_CELL * self.cell_m)

    def power(self, distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the power at a signed distance from the peak (Catmull-Rom spline of the
        amplitude)."""
        peak = self.peak()
        both = self.taps if peak else (*self.taps[:0:-1], *self.taps)
        peak = peak or len(self.taps) - 1
        root = np.sqrt(np.array([0, 0, *both, 0, 0]))
        side = np.where(distance_m < 0, -1, 1)
        place = abs(distance_m) / self.cell_m * TAPS_PER_CELL
        whole = np.floor(place).astype(int)
        t = place - whole
        a, b, c, d = (root[np.clip(peak + 2 + side * (whole + k), 0, len(root) - 1)]
                      for k in (-1, 0, 1, 2))
        amplitude = b + t / 2 * (c - a + t * (2 * a - 5 * b + 4 * c - d + t
                                              * (3 * (b - c) + d - a)))
        reach = np.where(side < 0, peak + 1, len(both) - peak)
        return np.asarray(np.where(place < reach, amplitude, 0) ** 2, float)

    def width_m(self) -> float:
        """Returns the full width of the response at half maximum, m."""
        step_m = self.cell_m / TAPS_PER_CELL / 64
        distance_m = step_m * np.arange(64 * (len(self.taps) + 1))
        return float(step_m * sum(np.argmax(self.power(side * distance_m) <= .5)
                                  for side in (-1, 1)))


def stated_in(meta: Mapping[str, str]) -> Response | None:
    """Returns the response stored in a run's metadata, or None if it is missing or invalid."""
    try:
        return Response(float(meta["radar_cell_m"]),
                        tuple(map(float, meta["radar_taps"].split(" +- ")[0].split())))
    except (KeyError, ValueError):
        return None


def filter_between(own: Response, target: Response, step_m: float) -> NDArray[np.float64]:
    """Returns the weights [2 reach + 1] of a filter that converts profiles with the response `own`
    to the response `target` (regularised least squares)."""
    reach_m = max(MIN_REACH_CELLS * max(own.cell_m, target.cell_m), own.extent_m(),
                  target.extent_m())
    reach = int(np.clip(np.ceil(reach_m / step_m), 1, MAX_REACH))
    at_m = np.arange(-2 * PARTS * reach, 2 * PARTS * reach + 1) / PARTS * step_m
    responses = own.power(np.arange(-reach, reach + 1) * step_m - at_m[:, None])
    square = responses.T @ responses / PARTS + NOISE_TO_SIGNAL * np.eye(2 * reach + 1)
    return np.linalg.solve(square, responses.T @ target.power(-at_m) / PARTS)


def filtered(table: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """Filters a table [n, points, ...] along its second dimension. Rows with constant values (dead
    sensor) are not changed."""
    reach, points = len(weights) // 2, table.shape[1]
    if points == 0:
        return table
    padded = np.pad(table, [(0, 0), (reach, reach)] + [(0, 0)] * (table.ndim - 2))
    out = sum(w * padded[:, k:k + points] for k, w in enumerate(weights))
    dead = (table == table[:, :1]).all(1, keepdims=True) & (table.ndim == 2)
    return np.where(dead, table, out).astype(np.float32)
