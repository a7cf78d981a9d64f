# SPDX-License-Identifier: MIT
"""Reads radar antenna samples (acquire/measurement/radar_array.hpp), and computes beams."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .run import Run

__all__ = ["beams", "frames", "values"]


def frames(run: Run) -> NDArray[np.uint64]:
    """Returns the number of radar frames in each record [n]."""
    return np.array([count for (count,) in run.of_records("array_frames")], np.uint64)


def values(run: Run) -> NDArray[np.float32]:
    """Returns the samples, powers and products of the antennas [n, bins, K], in the order of
    radar_array.hpp; NaN for records without antenna samples."""
    axis = run.axes["array"]
    count = int(axis.scale)
    out = np.full((len(run), axis.count, count * (count + 2) + 2), np.nan, np.float32)
    for row, found in run.array_bins():
        power, shares = found["power"][:, None], found["values"] / np.float32(32767)
        out[row, :, :2 * count] = shares[:, :2 * count] * np.sqrt(power)
        out[row, :, 2 * count:] = shares[:, 2 * count:] * power
    return out


def beams(run: Run, sines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the power [n, bins, sines] received from the azimuths with the given sines (Bartlett
    beam with calibrated gains and phases); NaN for records without antenna samples."""
    count, array = len(run.antennas), values(run).astype(float)
    first, last = np.triu_indices(count, 1)
    across, _, gain, phase = np.array(run.antennas).T
    h = np.exp(-1j * (phase[:, None] + np.pi * across[:, None] * sines)) / gain[:, None]
    pairs = array[..., 3 * count:-2]
    out = array[..., 2 * count:3 * count] @ abs(h) ** 2
    out += 2 * ((pairs[..., 0::2] + 1j * pairs[..., 1::2]) @ (h[first] * h[last].conj())).real
    return np.asarray(out / count ** 2)
