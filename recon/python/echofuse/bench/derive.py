# SPDX-License-Identifier: MIT
"""Copies of a run with changed records: fewer photons or records, background light, noise, lost
sensors. The copy is a run of its own (another uuid), so that no program takes it for the first one.

>>> from echofuse import derive
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


@dataclass
class Records:
    """Parts of a run that may change: rows that stay, counts [n, bins] or [n, zones,
    bins], linear or coded profiles
    [n, points] as stored, valid bits [n]."""

    run: runs.Run
    keep: NDArray[np.bool_] = field(init=False)
    spd: NDArray[np.uint32] = field(init=False)
    radar: NDArray[np.float32] = field(init=False)
    lost: dict[str, NDArray[np.bool_]] = field(init=False)
    range_offset_m: float = 0

    def __post_init__(self) -> None:
        self.keep = np.ones(len(self.run), bool)
        self.spd, self.radar = self.run.spd.copy(), self.run.stored_radar()
        self.lost = {name: ~valid for name, valid in self.run.valid.items()}


Change = Callable[[Records], None]


def copy(path: str | pathlib.Path, out: str | pathlib.Path, *changes: Change) -> pathlib.Path:
    """Writes the run `out` with these changes, one after the other, by `echofuse-acquire import`:
    what no change names is as in the run. No sensor is called weak, because the change makes it so.
    Raises FileExistsError, RuntimeError."""
    out = pathlib.Path(out)
    if out.exists():
        raise FileExistsError(f"{out}: exists already")
    with runs.open(path) as run:
        records = Records(run)
        for change in changes:
            change(records)
        bits = sum(np.where(records.lost[name], 0, bit) for name, bit in runs.SENSORS.items())
        tables: dict[str, NDArray[Any]] = {
                  "index": run.index, "valid": np.asarray(bits, np.uint8), "spd": records.spd,
                  "radar": records.radar}
        sections: dict[str, dict[str, Any]] = {
            "": {"run": str(run.path.resolve())},
            "radar": {"offset_m": -float(records.range_offset_m)},
            "signal": dict.fromkeys(("weak_share", "spd_clicks", "clicks_a_pulse", "radar_snr_db",
                                     "depth_share"), 0.0)}
        import_arrays(out, sections, {name: table[records.keep] for name, table in tables.items()
                                      if table.ndim == 1 or table.shape[1]})
    return out


def thinned(share: float, seed: int) -> Change:
    """A shorter exposure: each photon stays with this chance (binomial)."""
    def change(records: Records) -> None:
        records.spd = np.random.default_rng(seed).binomial(
            records.spd.astype(np.int64), share).astype(np.uint32)
    return change


def background(counts: float, seed: int) -> Change:
    """Room light: adds this number of counts per record, spread over all bins (Poisson)."""
    def change(records: Records) -> None:
        rate = counts / max(int(np.prod(records.spd.shape[1:])), 1)
        more = np.random.default_rng(seed).poisson(rate, records.spd.shape)
        records.spd = records.spd + more.astype(np.uint32)
    return change


def fewer(share: float, seed: int) -> Change:
    """A share of the records, drawn at random; at least one."""
    def change(records: Records) -> None:
        kept = np.random.default_rng(seed).permutation(len(records.keep))[:max(
            1, int(np.ceil(share * len(records.keep))))]
        records.keep &= np.isin(np.arange(len(records.keep)), kept)
    return change


def noise(snr_db: float, seed: int) -> Change:
    """White noise of power on each profile, so that its highest point is so many dB above the noise
    (linear axes)."""
    def change(records: Records) -> None:
        require_linear(records)
        peak = np.nanmax(records.radar, axis=1, keepdims=True)
        draws = np.random.default_rng(seed).normal(size=records.radar.shape)
        records.radar = (records.radar + peak * 10 ** (-snr_db / 10) * draws).astype(np.float32)
    return change


def range_offset(metres: float) -> Change:
    """A radar with distances too large by this number of metres (after its calibration)."""
    def change(records: Records) -> None:
        records.range_offset_m += metres
    return change


def lost(sensor: str) -> Change:
    """No record of this sensor: "spd", "radar", "depth"."""
    def change(records: Records) -> None:
        records.lost[sensor] = np.ones(len(records.keep), bool)
    return change


def gain(factor: float) -> Change:
    """The radar's power times a factor (linear axes)."""
    def change(records: Records) -> None:
        require_linear(records)
        records.radar = (records.radar * np.float32(factor)).astype(np.float32)
    return change


def require_linear(records: Records) -> None:
    """Raises ValueError unless the radar's profile is linear power, and nothing else holds it."""
    axis = records.run.axes.get("radar")
    if axis is None or axis.quantity not in ("power",
                                             "binned_power") or "array" in records.run.axes:
        raise ValueError(
            f"{records.run.path}: only a profile of linear power can be changed, without antennas "
            "beside it")


def read(path: str | pathlib.Path) -> Records:
    """The records of a run as changes see them."""
    with runs.open(path) as run:
        return Records(run)
