# SPDX-License-Identifier: MIT
"""Converts radar profiles so that they have the radar response of the training data
(recon/data/response_conversion.cpp)."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping

import numpy as np
from numpy.typing import NDArray

from ..runs.run_files import numbers_in

__all__ = ["Response", "filter_between", "filtered", "stated_in"]

# same values as in acquire/measurement/response.cpp
TAPS_PER_CELL, MAX_TAPS, CELLS_M, POWERS = 4, 64, (1e-3, 10), (0, 1.05)
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


def measured(text: str, minimum: float, maximum: float) -> tuple[float, ...]:
    """Returns the numbers in a text such as "1 0.5 +- 0.1" without the error, or an empty tuple if
    the text has another form or a number is outside the range (numbers_of() in
    acquire/measurement/response.cpp)."""
    text, plus, error = text.partition("+-")
    values, errors = numbers_in(text), numbers_in(error)
    valid = not plus or len(errors) == 1 and errors[0] >= 0
    return tuple(values) if valid and all(minimum <= v <= maximum for v in values) else ()


def stated_in(meta: Mapping[str, str]) -> Response | None:
    """Returns the response stored in a run's metadata, or None if it is missing or invalid, as
    response_of() does in C++."""
    cell = measured(meta.get("radar_cell_m", ""), *CELLS_M)
    taps = measured(meta.get("radar_taps", ""), *POWERS)
    if len(cell) != 1 or not 3 <= len(taps) <= MAX_TAPS:
        return None
    return Response(cell[0], taps) if abs(taps[0] - 1) < 1e-3 or abs(max(taps) - 1) < 1e-3 else None


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
