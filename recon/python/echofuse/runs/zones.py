# SPDX-License-Identifier: MIT
"""Zones of a detector. Each zone is a part of the field of view with its own histogram."""
from __future__ import annotations

import math
import sqlite3
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["Zone", "directions", "stored", "summed"]

MAX_ZONES = 64
Number = TypeVar("Number", bound=np.generic)


class Zone(NamedTuple):
    """The direction, the width and the time zero of a zone. The direction and the width are NaN if
    they are unknown."""

    x: float  # tangent of the zone centre, positive to the right
    y: float  # tangent of the zone centre, positive upwards
    width: float  # full width of the zone, tangent
    zero_ps: float = 0.0  # two-way time of range 0, ps

    def plausible(self) -> bool:
        """Returns whether the values are plausible, as in Zone::plausible
        (drivers/core/zone.hpp)."""
        unknown = all(map(math.isnan, self[:3]))
        return abs(self.zero_ps) <= 1e12 and (unknown or abs(self.x) <= 100 and abs(self.y) <= 100
                                              and 0 < self.width <= 200)

    @property
    def text(self) -> str:
        """Returns the zone in the format of run.toml."""
        return " ".join(map(repr, map(float, self)))


def stored(db: sqlite3.Connection) -> list[Zone]:
    """Returns the zones of a run, or an empty list for a single pixel. Raises ValueError if a zone
    is invalid."""
    if not db.execute("SELECT 1 FROM sqlite_schema WHERE name = 'zone'").fetchone():
        return []
    cursor = db.execute("SELECT CAST(x AS REAL), CAST(y AS REAL), CAST(width AS REAL), CAST("
                        "ifnull(zero_ps, 0) AS REAL) FROM zone ORDER BY rowid")
    rows = cursor.fetchmany(MAX_ZONES + 1)
    out = [Zone(*(math.nan if value is None else value for value in row)) for row in rows]
    if len(out) > MAX_ZONES or not all(map(Zone.plausible, out)):
        raise ValueError(f"table zone: expected at most {MAX_ZONES} zones, each with a centre, a "
                         "width and a time-zero offset")
    return out


def summed(counts: NDArray[Number]) -> NDArray[Number]:
    """Sums counts [n, zones, bins] over the zones. Counts [n, bins] are returned unchanged."""
    return np.asarray(counts.sum(1, dtype=counts.dtype)) if counts.ndim == 3 else counts


def directions(run: Any) -> NDArray[np.float64]:
    """Returns the tangents x, y and width of the zones [zones, 3]. Raises ValueError if they are
    unknown."""
    table = np.array([zone[:3] for zone in run.zones], float).reshape(-1, 3)
    if not len(table) or not np.isfinite(table).all():
        raise ValueError(f"{run.path}: the directions of the detector zones are unknown; set "
                         "spd.zones in run.toml, or send the zones in the hello message of the "
                         "bridge")
    return table
