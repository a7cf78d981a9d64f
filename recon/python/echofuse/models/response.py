# SPDX-License-Identifier: MIT
"""A run is brought to the radar's response of the model's training, as response_conversion.cpp does
it."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping

import numpy as np
from numpy.typing import NDArray

TAPS_A_CELL = 4  # acquire/measurement/response.hpp
# recon/data/response_conversion.cpp
REACH_CELLS, MOST_REACH, PARTS, NOISE_TO_SIGNAL, MUCH_NARROWER = 3, 48, 8, 1e-3, .75


@dataclass(frozen=True)
class Response:
    cell_m: float
    taps: tuple[float, ...]  # power over the peak's, from the peak on, TAPS_A_CELL a cell

    def power(self, distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Catmull and Rom's cubic of the amplitude; 0 beyond the taps."""
        place = abs(distance_m) / self.cell_m * TAPS_A_CELL
        whole = np.floor(place).astype(int)
        t = place - whole
        root = np.sqrt(np.array([*self.taps, 0, 0]))
        a, b, c, d = (root[np.minimum(abs(whole + k), len(self.taps))] for k in (-1, 0, 1, 2))
        amplitude = b + t / 2 * (c - a + t * (2 * a - 5 * b + 4 * c - d + t
                                              * (3 * (b - c) + d - a)))
        return np.asarray(np.where(place < len(self.taps), amplitude, 0) ** 2, float)

    def width_m(self) -> float:
        """The full width at half of the peak."""
        step_m = self.cell_m / TAPS_A_CELL / 64
        return float(2 * step_m
                     * np.argmax(self.power(step_m * np.arange(64 * (len(self.taps) + 1))) <= .5))


def stated_in(meta: Mapping[str, str]) -> Response | None:
    """As a run's metadata have it; None if they do not, or not as numbers."""
    try:
        return Response(float(meta["radar_cell_m"]),
                        tuple(map(float, meta["radar_taps"].split(" +- ")[0].split())))
    except (KeyError, ValueError):
        return None


def filter_between(own: Response, wanted: Response, step_m: float) -> NDArray[np.float64]:
    """Weights of 2 reach + 1 points that make of one response the other, as far as noise lets
    them."""
    reach = int(np.clip(np.ceil(REACH_CELLS * max(own.cell_m, wanted.cell_m) / step_m), 1,
                        MOST_REACH))
    at_m = np.arange(-2 * PARTS * reach, 2 * PARTS * reach + 1) / PARTS * step_m
    responses = own.power(at_m[:, None] - np.arange(-reach, reach + 1) * step_m)
    square = responses.T @ responses / PARTS + NOISE_TO_SIGNAL * np.eye(2 * reach + 1)
    return np.linalg.solve(square, responses.T @ wanted.power(at_m) / PARTS)


def filtered(table: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """[n, points, ...] along the points. A row that is the same throughout, of a dead sensor,
    stays."""
    reach, points = len(weights) // 2, table.shape[1]
    if points == 0:
        return table
    padded = np.pad(table, [(0, 0), (reach, reach)] + [(0, 0)] * (table.ndim - 2))
    out = sum(w * padded[:, k:k + points] for k, w in enumerate(weights))
    dead = (table == table[:, :1]).all(1, keepdims=True) & (table.ndim == 2)
    return np.where(dead, table, out).astype(np.float32)
