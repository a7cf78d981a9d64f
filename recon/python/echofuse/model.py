# SPDX-License-Identifier: MIT
"""Maps of a model, made in NumPy by the method of method.py: of each record the first estimator answers whose sensors
it has."""
from __future__ import annotations

import json
import pathlib
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import baselines
from . import run as runs
from .method import Method
from .response import MUCH_NARROWER, Response, filter_between, filtered, stated_in


def read_safetensors(path: str | pathlib.Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors and facts of a model file (recon/numbers/tensor_file.hpp). Raises ValueError for any other file."""
    kinds = {"F32": "<f4", "F64": "<f8", "I64": "<i8", "U32": "<u4", "U8": "u1"}
    contents = pathlib.Path(path).read_bytes()
    try:
        length, = struct.unpack_from("<Q", contents)
        head, data = json.loads(contents[8:8 + length]), contents[8 + length:]
        facts = json.loads(head.pop("__metadata__")["facts"])
        if facts["format"] != "echofuse model":
            raise ValueError
        return {name: np.frombuffer(data[slice(*t["data_offsets"])], kinds[t["dtype"]]).reshape(t["shape"])
                for name, t in head.items()}, facts
    except (ValueError, KeyError, TypeError, AttributeError, struct.error):
        raise ValueError(f"{path}: not a model of echofuse, or damaged") from None


class Estimator:
    """One way from records to maps: its tensors t and its facts f, as the file names them."""

    def __init__(self, tensors: dict[str, np.ndarray], facts: dict[str, Any], group: str) -> None:
        self.t = {name[len(group):]: values for name, values in tensors.items() if name.startswith(group)}
        self.f = {name[len(group):]: value for name, value in facts.items() if name.startswith(group)}
        self.kind, self.inputs, self.size = self.f["model"], self.f["inputs"], self.f["scene/map_size"]
        keys = ("quantity", "unit", "count", "start", "step", "scale")
        takes = {"spd": self.inputs != "radar", "radar": self.inputs != "spd", "array": self.inputs == "fused"}
        #: what a record must have, by sensor
        self.axes = {name: {key: self.f[f"axes/{name}/{key}"] for key in keys}
                     for name, taken in takes.items() if taken and self.f.get(f"axes/{name}/count", 0)}

    def matched(self, name: str, axis: runs.Axis | None, table: np.ndarray) -> np.ndarray:
        """Values on the axis that the estimator takes of the sensor; none if it does without."""
        return table[:, :0] if axis is None or name not in self.axes else axis.resampled(table, self.axes[name])

    def predict(self, counts: np.ndarray, power: np.ndarray, lags: np.ndarray) -> np.ndarray:
        """counts [n, bins], power [n, points], lags [n, points, 2 D + 1] or [n, 0, 1]: maps [n, N, N] in metres."""
        if self.kind in ("factorised", "silhouette"):
            maps = Method(self.t, self.f).predict(counts, power, lags)
        else:
            maps = baselines.predict(self.t, self.f, counts, power)
        return maps.reshape(-1, self.size, self.size)


@dataclass(frozen=True)
class Maps:
    depth_m: NDArray[np.float32]  # [n, N, N]; NaN: nothing returned
    index: NDArray[np.int64]  # of the records that have a map
    depth_x: NDArray[np.float64]  # tangents of the pixel centres
    depth_y: NDArray[np.float64]
    inputs: list[str]  # of the estimator that answered, a record each
    half_tangent: float  # of the edges of the field


class Model:
    def __init__(self, path: str | pathlib.Path) -> None:
        tensors, facts = read_safetensors(path)
        self.path, self.facts = pathlib.Path(path), facts
        #: of the radar, in training; None if it was not stated
        self.response = (Response(facts["response/cell_m"], tuple(tensors["response/taps"].ravel().tolist()))
                         if facts.get("response/known") else None)
        self.any_response = bool(facts["response/any"])  #: much narrower runs are taken as they are
        self.estimators = [Estimator(tensors, facts, f"{k}/") for k in range(facts["estimators"])]

    def predict(self, run: runs.Run | str | pathlib.Path, *, range_offset_m: float = 0) -> Maps:
        """range_offset_m: by how much the radar's ranges are too long, beside what the run's calibration says. Raises
        ValueError for a run on other axes."""
        run = run if isinstance(run, runs.Run) else runs.open(run)
        counts, power, lags = run.photons(), run.power(range_offset_m), run.lags(range_offset_m)
        stated = stated_in(run.meta)
        brought = (stated and self.response and stated != self.response and run.power_axis.unit == "m" and
                   not (self.any_response and stated.width_m() < MUCH_NARROWER * self.response.width_m()))
        weights = filter_between(stated, self.response, run.power_axis.step) if brought else None
        spd = run.valid["spd"] & ~same(counts)
        radar = run.valid["radar"] & ~same(power)
        first = self.estimators[0]
        maps = np.zeros((len(run), first.size, first.size), np.float32)
        by = np.full(len(run), -1)
        for k, estimator in enumerate(self.estimators):
            antennas = estimator.axes.get("array")
            if antennas is not None and (run.lags_axis is None or not run.lags_axis.is_near(antennas)):
                continue
            able = {"fused": spd & radar, "fused-profile": spd & radar, "spd": spd, "radar": radar}[estimator.inputs]
            if antennas is not None:
                able = able & (lags != 0).any((1, 2))
            rows = np.flatnonzero(able & (by < 0))
            if len(rows) == 0:
                continue
            axes = {"spd": run.axes.get("spd"), "radar": run.power_axis, "array": run.lags_axis}
            for name, axis in axes.items():
                if name in estimator.axes and not axis.is_near(estimator.axes[name]):
                    raise ValueError(f"{run.path}: its {name} axis is {axis}; {self.path} takes {estimator.axes[name]}")
            by[rows] = k
            spd_part, *of_radar = (estimator.matched(name, axes[name], table[rows]) for name, table in
                                   (("spd", counts), ("radar", power), ("array", lags)))
            if weights is not None:
                of_radar = [filtered(table, weights) for table in of_radar]
            maps[rows] = estimator.predict(spd_part, *of_radar)
        seen = np.flatnonzero(by >= 0)
        half = first.f["scene/map_half_tangent"]
        pixel = half * ((2 * np.arange(first.size) + 1) / first.size - 1)
        depth_m = np.minimum(np.where(maps[seen] > 0, maps[seen], np.float32(np.nan)), np.float32(first.f["scene/map_z_max_m"]))
        return Maps(depth_m, run.index[seen], pixel, -pixel,
                    [self.estimators[k].inputs for k in by[seen]], half)


def same(table: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Rows with the same value in every bin: of a dead sensor."""
    return (table == table[:, :1]).all(1) if table.shape[1] > 1 else np.zeros(len(table), bool)


def load_model(path: str | pathlib.Path) -> Model:
    return Model(path)
