# SPDX-License-Identifier: MIT
"""Predicts maps with a trained model in NumPy. The map of each record is predicted by the first
estimator for which all required sensors are valid in this record."""
from __future__ import annotations

import json
import math
import pathlib
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import runs
from ..runs import grid
from ..runs.arguments import (RANGE_OFFSET_M, ComparedByValue, entries, is_single, number, plain,
                              refused, rows_of)
from ..runs.axis import Axis, tangents
from ..runs.batches import blocks
from ..runs.run import opened
from ..runs.zones import summed
from . import baselines
from .crc32c import crc32c
from .maps import origin_of, save_maps
from .method import Method
from .response import MUCH_NARROWER, Response, filter_between, filtered, stated_in

__all__ = ["Estimator", "Maps", "Model", "load_model", "read_safetensors"]

MAX_POWER, MAX_CLICKS_PER_S = 1e38, 1e8  # as in drivers/core/sample.hpp
# Tolerances of the tangents of a zone's direction (x, y) and width (drivers/core/zone.hpp).
ZONE_TOLERANCES = np.array([0.01, 0.01, 0.02])


def read_safetensors(path: str | pathlib.Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Reads the tensors and the metadata of a model file (recon/numbers/tensor_file.hpp). Raises
    ValueError if the file is not a model file, or if its checksum is wrong."""
    kinds = {"F32": "<f4", "F64": "<f8", "I64": "<i8", "U32": "<u4", "U8": "u1"}
    contents = pathlib.Path(path).read_bytes()
    if contents.startswith(b"SQLite format 3"):
        raise ValueError(f"{path}: is a run; expected a model file")
    try:
        length, = struct.unpack_from("<Q", contents)
        at = contents.index(b'"crc32c":"', 8, 8 + length) + 10
        if int(contents[at:at + 8], 16) != crc32c(contents[:at] + b"0" * 8 + contents[at + 8:]):
            raise ValueError
        head, data = json.loads(contents[8:8 + length]), contents[8 + length:]
        facts = json.loads(head.pop("__metadata__")["facts"])
        if facts["format"] != "echofuse model":
            raise ValueError
        return {name: np.frombuffer(data[slice(*t["data_offsets"])],
                                    kinds[t["dtype"]]).reshape(t["shape"])
                for name, t in head.items()}, facts
    except (ValueError, KeyError, TypeError, AttributeError, struct.error):
        raise ValueError(f"{path}: not an echofuse model file, or damaged") from None


class Estimator:
    """Predicts maps from sensor data. t and f are the tensors and the metadata of the estimator."""

    def __init__(self, tensors: dict[str, NDArray[Any]], facts: dict[str, Any], group: str) -> None:
        self.t = {name[len(group):]: values for name, values in tensors.items()
                  if name.startswith(group)}
        self.f = {name[len(group):]: value for name, value in facts.items()
                  if name.startswith(group)}
        self.kind, self.inputs, self.size = (self.f["model"], self.f["inputs"],
                                             self.f["scene/map_size"])
        #: sensors that must be valid
        self.sensors = [name for name in ("spd", "radar")
                        if self.inputs in (name, "fused", "fused-profile")]
        keys = ("quantity", "unit", "count", "start", "step", "scale")
        groups = {name: f"axes/{name}" for name in self.sensors}
        groups |= {"lags": "axes/array"} if self.inputs == "fused" else {}
        #: axis of each required sensor, by sensor name
        self.axes = {name: Axis(name, *(self.f[f"{group}/{key}"] for key in keys))
                     for name, group in groups.items() if self.f.get(f"{group}/count", 0)}

    def matched(self, name: str, axis: Axis | None, table: NDArray[Any]) -> NDArray[Any]:
        """Resamples sensor values to the axis of the estimator. Returns [n, 0] if the estimator
        does not use the sensor."""
        return (table[:, :0] if axis is None
                or name not in self.axes else axis.resampled(table, self.axes[name]))

    def fault_of(self, row: int, has: dict[str, Any], varies: dict[str, Any]) -> str:
        """Returns why a record has no map, as fault_of() does in C++."""
        if missing := " and ".join(name for name in self.sensors if not has[name][row]):
            return f"lacks {missing}, which the model needs"
        if dead := [name for name in self.sensors if not varies[name][row]]:
            return f"{dead[0]} is the same in every bin"
        return "lacks the samples of the radar's antennas, which the model needs"

    def predict(self, counts: NDArray[Any], power: NDArray[Any], lags: NDArray[Any],
                zones: NDArray[Any]) -> NDArray[Any]:
        """Predicts maps [n, N, N], m, from counts [n, bins], power [n, points], lags [n, points,
        2 D + 1] or [n, 0, 1], and zones [n, zones, bins] or [n, 0, bins]."""
        if self.kind in ("factorised", "mean-shape"):
            maps = Method(self.t, self.f).predict(counts, power, lags, zones)
        else:
            spd = counts
            if zones.shape[1]:
                spd = zones.reshape(len(zones), math.prod(zones.shape[1:]))
            maps = baselines.predict(self.t, self.f, spd, power)
        return maps.reshape(-1, self.size, self.size)


class Arrays:
    """Arrays that are passed to a model instead of a run: counts [n, bins], linear power [n,
    points] and lags [n, points, 2 D + 1] (Run.lags), all at true ranges."""

    def __init__(self, axes: dict[str, Axis], spd: ArrayLike | None, radar: ArrayLike | None,
                 lags: ArrayLike | None) -> None:
        with np.errstate(over="ignore"):  # infinite values are refused below
            given = {name: plain(name, table)[0].astype(np.float32)
                     for name, table in (("spd", spd), ("radar", radar), ("lags", lags))
                     if table is not None}
        lost: dict[str, Any] = {}  # rows that contain only NaN, as in write_run()
        for name, table in given.items():
            if name not in axes:
                raise ValueError(f"{name}: shape {list(table.shape)} (expected none, because the "
                                 "model has no such axis)")
            expected = [axes[name].count, *[2 * int(axes[name].scale) + 1] * (name == "lags")]
            found = table.shape[2 if name == "spd" and table.ndim == 3 else 1:]  # without zones
            if [*found] != expected:
                raise ValueError(f"{name}: shape {list(table.shape)} (expected "
                                 f"[n, {', '.join(map(str, expected))}])")
            values = tuple(range(1, table.ndim))
            lost[name] = np.isnan(table).all(values)
            table[lost[name]] = 0
            valid = (abs(table) < MAX_POWER) & (table >= (0 if name == "spd" else -np.inf))
            if bad := np.flatnonzero(~valid.all(values)).tolist():
                raise ValueError(f"{name}: row {bad[0]} contains a non-finite value or a negative "
                                 f"count; remove {len(bad)} of {len(table)} rows")
        if len({len(table) for table in given.values()}) != 1:
            raise ValueError(
                "spd, radar: expected at least one of the two arrays, and the same number of "
                "records in both")
        self.path, self.meta, self.axes = "arrays", dict[str, str](), {
            name: axes[name] for name in given}
        self.index = np.arange(len(next(iter(given.values()))))
        self.power_axis, self.lags_axis = self.axes.get("radar"), self.axes.get("lags")
        self.valid = {name: ~lost.get(name, np.ones(len(self), bool)) for name in ("spd", "radar")}
        self._given = given

    def __len__(self) -> int:
        return len(self.index)

    def _table(self, name: str, empty: tuple[int, ...], by_m: float = 0) -> NDArray[np.float32]:
        if name not in self._given:
            return np.zeros((len(self), *empty), np.float32)
        return grid.shifted(self._given[name], by_m / self.axes[name].step)

    def photons(self) -> NDArray[np.float32]:
        return self._table("spd", (0,))

    def power(self, range_offset_m: float = 0) -> NDArray[np.float32]:
        return self._table("radar", (0,), range_offset_m)

    def lags(self, range_offset_m: float = 0) -> NDArray[np.float32]:
        return self._table("lags", (0, 1), range_offset_m)


@dataclass(frozen=True, repr=False, eq=False)
class Maps(ComparedByValue):
    """Depth maps predicted by a model. maps.depth_m[i] is the map of the record maps.index[i]."""

    depth_m: NDArray[np.float32]  #: z [n, N, N], m, top-left pixel first; NaN: no return
    index: NDArray[np.int64]  #: record index of each map [n]
    depth_x: NDArray[np.float64]  #: x / z of the pixel centres [N], positive to the right
    depth_y: NDArray[np.float64]  #: y / z of the pixel centres [N], positive upwards; top row first
    #: inputs of the estimator that predicted each map [n]: fused, fused-profile, spd or radar
    inputs: list[str]
    half_tangent: float  #: tangent at the map edges
    origin: str = ""  #: text of run.txt, which identifies the run
    #: why the other records have no map, by record index, as in C++
    faults: dict[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.index)

    @overload
    def __getitem__(self, rows: int | np.integer[Any]) -> NDArray[np.float32]: ...

    @overload
    def __getitem__(self, rows: slice | Sequence[int] | NDArray[Any]) -> Maps: ...

    def __getitem__(self, rows: Any) -> NDArray[np.float32] | Maps:
        """maps[3] and maps[-1] return one map [N, N], m. maps[10:20], maps[[1, 2]] and maps[mask]
        return Maps. Raises IndexError if a row does not exist."""
        if is_single(rows):
            return np.asarray(self.depth_m[rows])
        chosen = rows_of(len(self), rows)
        return replace(self, depth_m=self.depth_m[chosen], index=self.index[chosen],
                       inputs=[self.inputs[row] for row in chosen])

    def __repr__(self) -> str:
        size = self.depth_m.shape[1]
        return (f"<echofuse maps: {len(self)} maps of {size} x {size} pixels, m, tangents within "
                f"{self.half_tangent:g}>")

    def to_xarray(self) -> Any:
        """Returns depth_m as an xarray.DataArray (python3-xarray) with the dimensions record,
        depth_y and depth_x."""
        import xarray

        one = {"units": "1"}
        return xarray.DataArray(self.depth_m, {"record": self.index,
                                               "depth_y": ("depth_y", self.depth_y, one),
                                               "depth_x": ("depth_x", self.depth_x, one),
                                               "inputs": ("record", self.inputs)},
                                ("record", "depth_y", "depth_x"), "depth", {"units": "m"})

    def save(self, folder: str | pathlib.Path) -> None:
        """Writes FOLDER/maps.npy, records.csv and run.txt for `echofuse-recon evaluate --maps`."""
        save_maps(folder, self.depth_m, self.index, self.origin)


class Model:
    """A model that was read from a file written by `echofuse-recon train`. If a sensor is missing
    in a record, the map is predicted from the other sensor, provided that the model contains an
    estimator for that sensor."""

    def __init__(self, path: str | pathlib.Path) -> None:
        tensors, facts = read_safetensors(path)
        self.path, self.facts = pathlib.Path(path), facts
        #: radar response of the training runs; None if it is unknown
        self.response = (Response(facts["response/cell_m"],
                                  tuple(tensors["response/taps"].ravel().tolist()))
                         if facts.get("response/known") else None)
        #: run number, record index and part (2: held out) of each record of the training runs
        self.split = {key: tensors[f"split/{key}"].ravel() for key in ("run", "index", "part")}
        #: True: profiles with a much narrower response than in training are not converted
        self.any_response = bool(facts["response/any"])
        self.estimators = [Estimator(tensors, facts, f"{k}/") for k in range(facts["estimators"])]

    def __repr__(self) -> str:
        first = self.estimators[0]
        return (f"<echofuse model {self.path}: {first.kind}, {first.inputs}; axes "
                + ", ".join(f"{name} [n, {axis.count}] from {axis.start:g} {axis.unit} in steps of "
                            f"{axis.step:g}" for name, axis in self.axes.items())
                + f"; maps of {first.size} x {first.size}>")

    @property
    def axes(self) -> dict[str, Axis]:
        """Axes of the training data: "spd" (counts), "radar" (linear power), "lags" (Run.lags)."""
        return dict(self.estimators[0].axes)

    def predict(self, run: runs.Run | str | pathlib.Path | None = None, *,
                spd: ArrayLike | None = None,
                radar: ArrayLike | None = None, lags: ArrayLike | None = None,
                axes: dict[str, Axis] | None = None, range_offset_m: float = 0) -> Maps:
        """Predicts the maps of all records that have the required sensors. The input is a run (or
        its path), or arrays at true ranges: counts `spd` [n, bins], linear power `radar` [n,
        points] and `lags` (Run.lags), in which a row means a missing sensor if all its values are
        NaN, masked or None. The records of the arrays are numbered 0, 1, 2 ... `axes` are the axes
        of the arrays (default: Model.axes). `range_offset_m` is a radar range bias in
        metres, which is subtracted in addition to the calibrated offset of the run. Raises
        ValueError if the axes are incompatible or an argument is invalid. Damaged records of a run
        have no map."""
        range_offset_m = number("range_offset_m", range_offset_m, limits=RANGE_OFFSET_M)
        for name, axis in entries("axes", axes):
            if not isinstance(axis, Axis):
                raise refused(f"axes[{name!r}]", axis, "an Axis")
        if run is not None and any(given is not None for given in (spd, radar, lags, axes)):
            raise ValueError("predict: expected a run or arrays, not both")
        if run is None:
            return self._maps(Arrays(self.axes | (axes or {}), spd, radar, lags), range_offset_m)
        run, sensors = opened(run), self.estimators[0].sensors
        return joined([self._maps(part, range_offset_m, implausible(part, sensors) | {
            row: fault.removeprefix("unreadable: ") for row, fault in unreadable.items()})
            for _, part, unreadable in blocks(run, sensors=sensors)])

    def _maps(self, run: runs.Run | Arrays, range_offset_m: float,
              damaged: dict[int, str] | None = None) -> Maps:
        photons = run.photons()
        counts = summed(photons)
        power, lags = run.power(range_offset_m), run.lags(range_offset_m)
        stated = stated_in(run.meta)
        weights = None
        if (stated and self.response and stated != self.response and run.power_axis
            and run.power_axis.unit == "m"):
            if not (self.any_response and stated.width_m() < MUCH_NARROWER
                    * self.response.width_m()):
                weights = filter_between(stated, self.response, run.power_axis.step)
        varies = {name: run.valid[name] & ~is_constant(table)
                  for name, table in (("spd", counts), ("radar", power))}
        for row in damaged or {}:
            varies["spd"][row] = varies["radar"][row] = False
        first = self.estimators[0]
        maps = np.zeros((len(run), first.size, first.size), np.float32)
        by = np.full(len(run), -1)
        for k, estimator in enumerate(self.estimators):
            antennas = estimator.axes.get("lags")
            if antennas is not None and (run.lags_axis is None
                                         or not run.lags_axis.is_near(antennas)):
                continue
            able = np.logical_and.reduce([varies[name] for name in estimator.sensors])
            if antennas is not None:
                able = able & (lags != 0).any((1, 2))
            rows = np.flatnonzero(able & (by < 0))
            if len(rows) == 0:
                continue
            axes_of = {"spd": run.axes.get("spd"), "radar": run.power_axis, "lags": run.lags_axis}
            for name, axis in axes_of.items():
                if name in estimator.axes and not (axis and axis.is_near(estimator.axes[name])):
                    raise ValueError(f"{run.path}: {name} axis: {axis or 'no points'} (expected by "
                        f"{self.path}: {estimator.axes[name]})")
            by[rows] = k
            inputs = {name: estimator.matched(name, axes_of[name], table[rows])
                      for name, table in (("spd", counts), ("radar", power), ("lags", lags))}
            if weights is not None:
                inputs |= {name: filtered(inputs[name], weights) for name in ("radar", "lags")}
            maps[rows] = estimator.predict(inputs["spd"], inputs["radar"], inputs["lags"],
                                           zones_of(estimator, run, photons, rows))
        done = np.flatnonzero(by >= 0)
        half = first.f["scene/map_half_tangent"]
        axes = [tangents(name, first.size, half) for name in ("depth_x", "depth_y")]
        # Uses the axes of the run if they differ only by rounding; xarray aligns only equal axes.
        x, y = (run.axes[axis.name] if axis.is_same(run.axes.get(axis.name)) else axis
                for axis in axes)
        depth_m = np.minimum(np.where(maps[done] > 0, maps[done], np.float32(np.nan)),
                             np.float32(first.f["scene/map_z_max_m"]))
        faults = {int(run.index[row]): first.fault_of(row, run.valid, varies)
                  for row in np.flatnonzero(by < 0)}
        faults |= {int(run.index[row]): fault for row, fault in (damaged or {}).items()}
        return Maps(depth_m, run.index[done], x.values, y.values,
                    [self.estimators[k].inputs for k in by[done]], half, self._origin(run), faults)

    def _origin(self, run: runs.Run | Arrays) -> str:
        """Returns the text of run.txt. The text identifies the run, and lists the records of the
        run on which this model was trained."""
        if isinstance(run, Arrays):
            return ""
        uuid = run.info["uuid"]
        known = np.array([self.facts[f"split/run/{k}"] == uuid
                          for k in range(self.facts["split/runs"])], bool)
        index = self.split["index"][known[self.split["run"]] & (self.split["part"] < 2)]
        trained = "trained on records " + ",".join(map(str, index)) + "\n" if len(index) else ""
        return origin_of(run) + trained


def zones_of(estimator: Estimator, run: runs.Run | Arrays, photons: NDArray[Any],
             rows: NDArray[np.int64]) -> NDArray[Any]:
    """Returns the zone counts [n, zones, bins] of the given rows, or [n, 0, 0] if the estimator
    does not use zones. Raises ValueError if the number of zones differs from that of the
    estimator."""
    zones = estimator.f.get("zones", 0)
    if not zones:
        return np.zeros((len(rows), 0, 0), np.float32)
    if photons.ndim != 3 or photons.shape[1] != zones:
        found = photons.shape[1] if photons.ndim == 3 else 1
        raise ValueError(f"{run.path}: the detector has {found} zones (expected by the model: "
                         f"{zones})")
    if not isinstance(run, Arrays):
        views = np.array([(zone.x, zone.y, zone.width) for zone in run.zones])
        known, expected = bool(np.isfinite(views).all()), estimator.t.get("zone_views")
        if known != (expected is not None):
            raise ValueError(f"{run.path}: the directions of the zones are "
                             + ("known, expected unknown" if known else "unknown, expected known"))
        if known and not (np.abs(views - expected) < ZONE_TOLERANCES).all():
            raise ValueError(f"{run.path}: the detector zones have other directions or widths than "
                             "those in training; are they in another order?")
    return np.stack([estimator.matched("spd", run.axes["spd"], photons[rows, k])
                     for k in range(zones)], 1)


def implausible(part: runs.Run, sensors: list[str]) -> dict[int, str]:
    """Returns why records with impossible values have no map, by row (Appender::add() in
    recon/data/dataset.cpp)."""
    out = {}
    if "spd" in sensors:
        counts = part.spd.reshape(len(part), math.prod(part.spd.shape[1:]))
        slot_s = part.quality()["length_s"]
        max_counts = np.where(slot_s > 0, MAX_CLICKS_PER_S * slot_s, np.inf)
        impossible = (counts > max_counts[:, None]) | (counts == 2 ** 32 - 1)
        for row, bin_ in np.argwhere(impossible)[::-1]:
            out[int(row)] = (f"spd bin {bin_} contains {counts[row, bin_]} clicks, more than a "
                             "time tagger can send")
    if "radar" in sensors:
        valid = (abs(np.nan_to_num(part.radar)) < MAX_POWER).all(1)
        valid &= (abs(part.lags()) < MAX_POWER).all((1, 2))
        out = {int(row): "a radar value is not a finite power"
               for row in np.flatnonzero(~valid)} | out
    return out


def joined(parts: list[Maps]) -> Maps:
    """Returns the maps of consecutive blocks of a run."""
    return replace(parts[0], depth_m=np.concatenate([part.depth_m for part in parts]),
                   index=np.concatenate([part.index for part in parts]),
                   inputs=[name for part in parts for name in part.inputs],
                   faults={index: fault for part in parts for index, fault in part.faults.items()})


def is_constant(table: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Returns whether each row has equal values in all bins, as in data from a dead sensor."""
    return np.asarray(
        (table == table[:, :1]).all(1)) if table.shape[1] > 1 else np.zeros(len(table), bool)


def load_model(path: str | pathlib.Path) -> Model:
    """Reads a model file. Raises ValueError if the file is not a model."""
    return Model(path)
