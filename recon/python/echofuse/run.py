# SPDX-License-Identifier: MIT
"""A run file (acquire/README.md) as arrays: sqlite3 and numpy, nothing else."""
from __future__ import annotations

import pathlib
import sqlite3
import struct
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

SENSORS = {"spd": 1, "radar": 2, "depth": 4}  # bits of record.valid
APPLICATION_ID, FORMAT_VERSION = 0x4543464D, 1


@dataclass(frozen=True)
class Axis:
    """Of bins or pixels: value i is start + i * step."""

    name: str
    quantity: str
    unit: str
    count: int
    start: float
    step: float
    scale: float

    @property
    def values(self) -> NDArray[np.float64]:
        return self.start + self.step * np.arange(self.count)


def open(path: str | pathlib.Path) -> "Run":  # noqa: A001 (the name that is wanted)
    """The run of this file, or of the name that `echofuse-acquire run --out` got. Raises FileNotFoundError, or
    ValueError for a file that is no run."""
    found = pathlib.Path(path)
    if not found.is_file() and not found.suffix:
        found = found.with_name(found.name + ".sqlite")
    if not found.is_file():
        raise FileNotFoundError(f"{path}: no such run")
    return Run(found)


class Run:
    """Values as recorded, a row a record. Of a sensor that a record lacks the row is 0 (counts) or NaN; `valid`
    tells. The records are those of the moment of opening."""

    def __init__(self, path: pathlib.Path) -> None:
        self.path = path
        with sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True) as db:
            try:
                identity = db.execute("PRAGMA application_id").fetchone()[0]
                version = db.execute("PRAGMA user_version").fetchone()[0]
            except sqlite3.DatabaseError as error:
                raise ValueError(f"{path}: not a run of echofuse: {error}") from None
            if identity != APPLICATION_ID or version > FORMAT_VERSION:
                raise ValueError(f"{path}: not a run of echofuse, or of a newer version")
            self.axes: dict[str, Axis] = {row[0]: Axis(*row) for row in db.execute(
                "SELECT name, quantity, unit, count, start, step, scale FROM axis")}
            cursor = db.execute("SELECT * FROM run")
            self.info: dict[str, Any] = dict(zip((column[0] for column in cursor.description), cursor.fetchone()))
            rows = db.execute("SELECT idx, valid, label, slot_utc_ns FROM record ORDER BY idx").fetchall()
        index, bits, labels, utc = zip(*rows) if rows else ((), (), (), ())
        self.index: NDArray[np.int64] = np.array(index, np.int64)
        self.labels: list[str] = list(labels)
        #: the start of each record's slot, UTC
        self.time: NDArray[np.datetime64] = np.array(utc, "datetime64[ns]")
        mask = np.array(bits, np.int64)
        self.valid: dict[str, NDArray[np.bool_]] = {name: (mask & bit) != 0 for name, bit in SENSORS.items()}

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        return f"<echofuse run {self.path}: {len(self)} records, {self.info['status']}>"

    @cached_property
    def spd(self) -> NDArray[np.uint32]:
        """Counts [n, bins]."""
        return self._table("spd", "<u4", 0)

    @cached_property
    def radar(self) -> NDArray[np.float32]:
        """Linear power [n, bins], in an arbitrary unit."""
        table = self._table("radar", "<f4", np.nan)
        axis = self.axes.get("radar")
        if axis is not None and axis.quantity == "log2_q8":  # TI's codes (drivers/core/log2_codes.hpp)
            antennas = max(1, int(axis.scale))
            table = np.exp2(table.astype(np.float64) * (2 / 256 * (1 << (antennas - 1).bit_length()) / antennas))
        return table.astype(np.float32)

    @cached_property
    def depth(self) -> NDArray[np.float32]:
        """z in metres [n, rows, columns] of the camera's image; NaN where nothing came back."""
        size = tuple(self.axes[name].count if name in self.axes else 0 for name in ("depth_y", "depth_x"))
        out = np.full((len(self), *size), np.nan, np.float32)
        for row, png in self._blobs("depth"):
            image = decode_png16(png, size)
            out[row] = np.where(image > 0, image / np.float32(1000), np.float32(np.nan))
        return out

    def to_xarray(self) -> Any:
        """The same as an xarray.Dataset (python3-xarray) with named axes."""
        import xarray

        def coordinate(name: str) -> tuple[str, NDArray[np.float64], dict[str, str]]:
            axis = self.axes[name]
            return (name, axis.values, {"units": axis.unit})

        shapes = {"spd": ("spd_bin",), "radar": ("radar_bin",), "depth": ("depth_y", "depth_x")}
        axes = {"spd_bin": "spd", "radar_bin": "radar", "depth_y": "depth_y", "depth_x": "depth_x"}
        data, coords = {}, {"record": self.index, "time": ("record", self.time), "label": ("record", self.labels)}
        for sensor, dims in shapes.items():
            if not all(axes[dim] in self.axes for dim in dims):
                continue
            data[sensor] = (("record", *dims), getattr(self, sensor))
            coords[f"{sensor}_valid"] = ("record", self.valid[sensor])
            for dim in dims:
                _, values, attributes = coordinate(axes[dim])
                coords[dim] = (dim, values, attributes)
        return xarray.Dataset(data, coords, {key: str(value) for key, value in self.info.items()})

    def _blobs(self, sensor: str) -> list[tuple[int, bytes]]:
        with sqlite3.connect(f"{self.path.resolve().as_uri()}?mode=ro", uri=True) as db:
            rows = db.execute(f"SELECT idx, {sensor} FROM record WHERE valid & ?", (SENSORS[sensor],))
            blobs = {index: blob or b"" for index, blob in rows}
        return [(row, blobs[index]) for row, index in enumerate(self.index.tolist()) if index in blobs]

    def _table(self, sensor: str, kind: str, missing: float) -> NDArray[Any]:
        count = self.axes[sensor].count if sensor in self.axes else 0
        out = np.full((len(self), count), missing, kind)
        for row, blob in self._blobs(sensor):
            if len(blob) != count * out.itemsize:
                raise ValueError(f"{self.path}: record {self.index[row]}: {sensor} has {len(blob)} bytes; "
                                 f"its axis asks for {count * out.itemsize}")
            out[row] = np.frombuffer(blob, kind)
        return out


def decode_png16(png: bytes, size: tuple[int, int]) -> NDArray[np.uint16]:
    """A PNG as run files have it: 16 bits, grey, without filters (acquire/record/png.cpp). Raises ValueError."""
    fault = ValueError(f"a depth image is not a 16-bit grey PNG of {size[1]} x {size[0]}")
    if png[:8] != b"\x89PNG\r\n\x1a\n" or png[16:29] != struct.pack(">II", size[1], size[0]) + b"\x10\0\0\0\0":
        raise fault
    at, data = 33, b""
    while at + 12 <= len(png):
        length, name = struct.unpack(">I4s", png[at:at + 8])
        data += png[at + 8:at + 8 + length] if name == b"IDAT" else b""
        at += 12 + length
    stride = 2 * size[1] + 1
    try:
        packed = zlib.decompressobj().decompress(data, size[0] * stride)
        lines = np.frombuffer(packed, np.uint8).reshape(size[0], stride)
    except (zlib.error, ValueError):
        raise fault from None
    if lines[:, 0].any():
        raise fault
    return np.ascontiguousarray(lines[:, 1:]).view(">u2").astype(np.uint16)
