# SPDX-License-Identifier: MIT
"""Copies a run and degrades the copy, for example by removing photons, records or sensors, or by
adding background light or noise. The copy has a new UUID.

>>> from echofuse.bench import derive
>>> derive.copy("monday.sqlite", "dim.sqlite", derive.thinned(0.1, seed=1))
"""
from __future__ import annotations

import pathlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..runs.acquire import import_arrays

__all__ = ["Change", "Records", "background", "copy", "fewer", "gain", "lost", "noise",
           "range_offset", "read", "thinned"]


@dataclass
class Records:
    """Data of a run that a Change function may edit in place."""

    run: runs.Run  #: the run that is copied
    keep: NDArray[np.bool_] = field(init=False)  #: True for each record to copy [n]
    spd: NDArray[np.uint32] = field(init=False)  #: counts [n, bins] or [n, zones, bins]
    radar: NDArray[np.float32] = field(init=False)  #: range profiles as stored [n, points]
    #: maps each sensor name to flags [n]; True: the record has no data from this sensor
    lost: dict[str, NDArray[np.bool_]] = field(init=False)
    range_offset_m: float = 0  #: range bias to add to the radar, m

    def __post_init__(self) -> None:
        self.keep = np.ones(len(self.run), bool)
        self.spd, self.radar = self.run.spd.copy(), self.run.radar.copy()
        self.lost = {name: ~valid for name, valid in self.run.valid.items()}


Change = Callable[[Records], None]


def copy(path: str | pathlib.Path, out: str | pathlib.Path, *changes: Change) -> pathlib.Path:
    """Reads a run, applies the changes in order, and writes the result to `out` with
    `echofuse-acquire import`. The signal checks are disabled, because a change may weaken a sensor
    on purpose. Raises FileExistsError if `out` exists, and RuntimeError if the import fails."""
    out = pathlib.Path(out)
    if out.exists():
        raise FileExistsError(f"{out}: exists already")
    with runs.open(path) as run:
        records = Records(run)
        for change in changes:
            change(records)
        bits = sum(np.where(records.lost[name], 0, bit) for name, bit in runs.SENSORS.items())
        tables: dict[str, NDArray[Any]] = {"index": run.index, "valid": np.asarray(bits, np.uint8),
                                           "spd": records.spd, "radar": records.radar}
        sections: dict[str, dict[str, Any]] = {"": {"run": str(run.path.resolve())},
            "radar": {"offset_m": -float(records.range_offset_m)},
            "signal": dict.fromkeys(("weak_share", "spd_clicks", "clicks_per_pulse", "radar_snr_db",
                                     "depth_share"), 0.0)}
        import_arrays(out, sections, {name: table[records.keep] for name, table in tables.items()
                                      if table.ndim == 1 or table.shape[1]})
    return out


def thinned(share: float, seed: int) -> Change:
    """Keeps each photon with probability `share` (binomial), as a shorter exposure would."""
    def change(records: Records) -> None:
        records.spd = np.random.default_rng(seed).binomial(
            records.spd.astype(np.int64), share).astype(np.uint32)
    return change


def background(counts: float, seed: int) -> Change:
    """Adds room light: Poisson counts with a mean of `counts` per record, spread uniformly over all
    bins."""
    def change(records: Records) -> None:
        rate = counts / max(int(np.prod(records.spd.shape[1:])), 1)
        more = np.random.default_rng(seed).poisson(rate, records.spd.shape)
        records.spd = records.spd + more.astype(np.uint32)
    return change


def fewer(share: float, seed: int) -> Change:
    """Keeps a random fraction `share` of the records, but at least one record."""
    def change(records: Records) -> None:
        kept = np.random.default_rng(seed).permutation(len(records.keep))[:max(
            1, int(np.ceil(share * len(records.keep))))]
        records.keep &= np.isin(np.arange(len(records.keep)), kept)
    return change


def noise(snr_db: float, seed: int) -> Change:
    """Adds Gaussian noise to each linear-power profile. The standard deviation of the noise is
    `snr_db` dB below the peak of that profile."""
    def change(records: Records) -> None:
        require_linear(records)
        peak = np.nanmax(records.radar, axis=1, keepdims=True)
        draws = np.random.default_rng(seed).normal(size=records.radar.shape)
        records.radar = (records.radar + peak * 10 ** (-snr_db / 10) * draws).astype(np.float32)
    return change


def range_offset(metres: float) -> Change:
    """Adds a bias in metres to the calibrated radar ranges."""
    def change(records: Records) -> None:
        records.range_offset_m += metres
    return change


def lost(sensor: str) -> Change:
    """Removes all samples of a sensor: "spd", "radar" or "depth"."""
    def change(records: Records) -> None:
        records.lost[sensor] = np.ones(len(records.keep), bool)
    return change


def gain(factor: float) -> Change:
    """Multiplies the linear radar power by a factor."""
    def change(records: Records) -> None:
        require_linear(records)
        records.radar = (records.radar * np.float32(factor)).astype(np.float32)
    return change


def require_linear(records: Records) -> None:
    """Raises ValueError if the radar data are not linear power, or contain antenna samples."""
    axis = records.run.axes.get("radar")
    if not axis or axis.quantity not in ("power", "binned_power") or "array" in records.run.axes:
        raise ValueError(
            f"{records.run.path}: expected radar profiles in linear power, and no antenna samples")


def read(path: str | pathlib.Path) -> Records:
    """Reads the data of a run into Records that a Change function can edit."""
    with runs.open(path) as run:
        return Records(run)
