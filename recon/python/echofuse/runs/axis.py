# SPDX-License-Identifier: MIT
"""Axes of histograms, range profiles and images."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Axis", "tangents"]


@dataclass(frozen=True)
class Axis:
    """Axis of bins, range points or pixels. The position of point i is start + i * step."""

    name: str  #: name of the axis, e.g. spd, radar, array, depth_x or depth_y
    quantity: str  #: kind of the data, e.g. counts, power, covariance or tangent
    unit: str  #: unit of the positions: ps, m or 1
    count: int  #: number of points
    start: float  #: position of point 0
    step: float  #: distance between neighbouring points
    scale: float  #: number of antennas or of antenna lags; 1 for axes without antennas

    def __str__(self) -> str:
        return (f"{self.count} points of {self.quantity} from {self.start:g} {self.unit} in steps "
                f"of {self.step:g}")

    @property
    def values(self) -> NDArray[np.float64]:
        """Positions of the points [count], in `unit`."""
        return self.start + self.step * np.arange(self.count)

    def is_near(self, other: Axis) -> bool:
        """Returns whether the positions on this axis and on `other` differ by at most one bin. This
        axis may have more bins than `other`."""
        start = self.start - other.start
        end = start + (self.step - other.step) * other.count
        return bool(self.quantity == other.quantity and self.unit == other.unit
                    and self.scale == other.scale and self.count >= other.count
                    and max(abs(start), abs(end)) <= abs(other.step))

    def is_same(self, other: Axis | None) -> bool:
        """Returns whether the positions on this axis and on `other` are equal, apart from rounding
        errors."""
        return bool(other and self.quantity == other.quantity and self.count == other.count
                    and np.allclose(self.values, other.values, 0, 1e-3 * abs(self.step)))

    def resampled(self, table: NDArray[np.float32], target: Axis) -> NDArray[np.float32]:
        """Interpolates values [n, bins, ...] linearly at the positions of another axis."""
        start = self.start - target.start
        end = start + (self.step - target.step) * target.count
        if max(abs(start), abs(end)) <= 1e-3 * abs(target.step):
            return table[:, :target.count]
        place = ((target.values - self.start) / self.step).clip(0, self.count - 1)
        first = place.astype(int)
        part = (place - first).astype(np.float32).reshape(-1, *[1] * (table.ndim - 2))
        return np.asarray((1 - part) * table[:, first] + part
                          * table[:, np.minimum(first + 1, self.count - 1)])


def tangents(name: str, count: int, half: float) -> Axis:
    """Returns the axis of `count` pixels that span the tangents from -half to half
    (acquire/measurement/depth_map.cpp). If the name ends with y, the first pixel is the top row."""
    sign = -1 if name.endswith("y") else 1
    step = 2 * half / count
    return Axis(name, "tangent", "1", count, -sign * (half - step / 2), sign * step, 1)
