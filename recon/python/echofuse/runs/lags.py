# SPDX-License-Identifier: MIT
"""Computes correlations between the antennas of a radar (recon/data/lags.hpp)."""
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .axis import Axis

__all__ = ["Pairs", "axis_of", "of_bins", "pairs_of"]

Pairs = dict[int, list[tuple[int, int]]]  # pairs of antennas by their spacing in half wavelengths


def pairs_of(antennas: list[tuple[float, ...]]) -> tuple[Pairs, Pairs]:
    """Returns the horizontal and the vertical pairs of antennas."""
    found: tuple[Pairs, Pairs] = ({}, {})
    for m, (xm, ym, *_) in enumerate(antennas):
        for n, (xn, yn, *_) in enumerate(antennas):
            for lags, along, aside in ((found[0], xm - xn, ym - yn), (found[1], ym - yn, xm - xn)):
                lag = round(along)
                if 1 <= lag <= 16 and abs(along - lag) <= 0.01 and abs(aside) <= 0.01:
                    lags.setdefault(lag, []).append((m, n))
    return found[0], found[1] if found[0] else {}


def axis_of(axis: Axis | None, pairs: tuple[Pairs, Pairs]) -> Axis | None:
    """Returns the axis of the lags; None if there are none."""
    if axis is None or not pairs[0]:
        return None
    across, up = (max(lags, default=0) for lags in pairs)
    known = sorted({*pairs[0], *(across + lag for lag in pairs[1])})
    quantity = "lags" + ("" if len(known) == across + up else "".join(f" {lag}" for lag in known))
    return Axis("lags", quantity + (f", {up} up" if up else ""), axis.unit, axis.count, axis.start,
                axis.step, across + up)


def of_bins(bins: NDArray[Any], antennas: list[tuple[float, ...]],
            pairs: tuple[Pairs, Pairs]) -> NDArray[np.float64]:
    """Returns the lags [points, 2 D + 1] of the bins of one record (Run.array_bins)."""
    count = len(antennas)
    first, last = np.triu_indices(count, 1)
    response = np.array([gain * np.exp(1j * phase) for *_, gain, phase in antennas])
    values = bins["values"] / 32767 * bins["power"][:, None].astype(float)
    r = np.zeros((len(bins), count, count), complex)
    correlations = values[:, 3 * count:-2]
    r[:, first, last] = correlations[:, 0::2] + 1j * correlations[:, 1::2]
    r[:, last, first] = r[:, first, last].conj()
    across, up = (max(lags, default=0) for lags in pairs)
    out = np.zeros((len(bins), 1 + 2 * (across + up)))
    out[:, 0] = (values[:, 2 * count:3 * count] / abs(response) ** 2).mean(1)
    for before, lags in zip((0, across), pairs):
        for lag, places in lags.items():
            c = np.mean([r[:, m, n] / (response[m] * response[n].conj()) for m, n in places], 0)
            at = 2 * (before + lag)
            out[:, at - 1], out[:, at] = c.real, c.imag
    return out
