# SPDX-License-Identifier: MIT
"""Reads a run file (acquire/RUN_FILE.md) as arrays. Requires only sqlite3 and NumPy."""
from __future__ import annotations

import html
import json
import pathlib
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any, Iterator, Sequence, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import grid, pile_up
from . import lags as antenna_lags
from .arguments import RANGE_OFFSET_M, errors_with_path, is_single, number, rows_of
from .axis import Axis, tangents
from .grid import Growing, inflated, read_only, shifted
from .record import Record
from .run_files import (NULL_INTEGER, STATISTICS, Connection, antennas_of, axes_of, connect,
                        leftovers, meta_of, offsets_of, query, status_of, table)
from .zones import Zone
from .zones import stored as stored_zones

__all__ = ["PS_PER_M", "SENSORS", "Run", "open", "opened"]

SENSORS = {"spd": 1, "radar": 2, "depth": 4}  # bits of the column record.valid
PS_PER_M = 2e12 / 299_792_458.0  # two-way time of flight per metre of range, ps
MAX_PIXELS, MAX_INDEX = 1 << 23, 1 << 53  # pixels per image; number of a record
BLOCK = 64  # number of records that an iteration reads at once
METRES = np.arange(1 << 16, dtype=np.float32) / np.float32(1000)  # z of each value of a pixel, m
METRES[0] = np.nan
APPENDING = threading.RLock()


def open(path: str | pathlib.Path) -> "Run":  # noqa: A001 (intended name)
    """Opens a run, given its file or the NAME of `echofuse-acquire run --out NAME`. Raises
    FileNotFoundError, IsADirectoryError for a folder, or ValueError if the file is not a run."""
    given = pathlib.Path(path).absolute()
    named = given if given.suffix == ".sqlite" else pathlib.Path(f"{given}.sqlite")
    found = given if given.is_file() else named
    if not found.is_file():
        if given.is_dir() or named.is_dir():
            raise IsADirectoryError(f"{given}: is a folder; expected a run file")
        if given.exists() or named.exists():
            raise ValueError(f"{given}: is not a regular file; expected a run file")
        raise FileNotFoundError(f"{path}: no such run file")
    for file in leftovers(found):
        warnings.warn(f"{file}: not read, because the run is closed; move it away", stacklevel=2)
    return Run(found)


def opened(run: "Run | str | pathlib.Path") -> "Run":
    """Returns the run. If `run` is a path, opens the run at this path."""
    return run if isinstance(run, Run) else open(run)


class Run:
    """Recorded values, one row per record. If a sensor is missing, its row is 0 (counts) or NaN,
    and `valid` is false. Records added after open() or the last refresh() are not included."""

    path: pathlib.Path  #: absolute path of the run file
    info: dict[str, Any]  #: columns of the table `run`, and the status of the run
    meta: dict[str, str]  #: additional metadata of the run, by name
    index: NDArray[np.int64]  #: number of each record in the run file [n]
    time: NDArray[np.datetime64]  #: start of each slot, UTC [n]
    labels: list[str]  #: label of each record; may be empty
    valid: dict[str, NDArray[np.bool_]]  #: for each sensor, whether each record has data [n]
    axes: dict[str, Axis]  #: axes of the arrays, by name
    offset_m: dict[str, float]  #: range bias of each sensor, m; true range = measured range - bias
    zones: list[Zone]  #: zones of the detector; empty for a single pixel
    #: x, y (half wavelengths), gain and phase (rad) of each virtual radar antenna
    antennas: list[tuple[float, ...]]

    def __init__(self, path: pathlib.Path) -> None:
        self.path, self.info = path, {}
        self._grown: dict[str, Growing] = {}  # arrays to which refresh() appends
        self._block: tuple[int, Run] | None = None  # first row, and records, of an iteration
        self._read()

    def __enter__(self) -> "Run":
        return self

    def __exit__(self, *_: object) -> None:
        """Releases the arrays. The run file is open only during calls."""
        self._forget()

    def __iter__(self) -> Iterator[Record]:
        for first in range(0, len(self), BLOCK):
            self._block = first, self[first:first + BLOCK]
            yield from (Record(self, first + row) for row in range(len(self._block[1])))
        self._block = None

    @overload
    def __getitem__(self, rows: int | np.integer[Any]) -> Record: ...

    @overload
    def __getitem__(self, rows: slice | Sequence[int] | NDArray[Any]) -> "Run": ...

    def __getitem__(self, rows: Any) -> "Record | Run":
        """run[3] and run[-1] return one record. run[10:20], run[[1, 2]] and run[mask] return a run
        of the selected records, with the axes, tables and events of the whole run."""
        if is_single(rows):
            return Record(self, range(len(self))[rows])
        chosen, part = rows_of(len(self), rows), Run.__new__(Run)
        part.__dict__ |= self.__dict__ | {"_grown": {}, "_block": None}
        part.index, part.time = self.index[chosen], self.time[chosen]
        part.labels = [self.labels[row] for row in chosen]
        part.valid = {name: mask[chosen] for name, mask in self.valid.items()}
        return part

    def __copy__(self) -> "Run":
        return self[:]

    def refresh(self) -> "Run":
        """Reads the new records of the run file. A run of selected records becomes the whole
        run."""
        with APPENDING:
            self._read()
        return self

    def _forget(self) -> None:
        for name in ("lags_axis", "_pairs", "_cells"):
            self.__dict__.pop(name, None)
        for name in ("spd", "radar", "depth", "map", "map is known"):
            self._grown.pop(name, None)

    def _grow(self, name: str, rows: NDArray[Any], known: int | None = None) -> NDArray[Any]:
        """Appends rows to an array that has `known` rows, and returns the whole array. If another
        thread has appended these rows, they are not appended again."""
        with APPENDING:
            if name not in self._grown:
                self._grown[name] = Growing(rows)
            elif known is None or known == len(self._grown[name].values):
                self._grown[name].append(rows)
            return self._grown[name].values

    @errors_with_path
    def _cached(self, name: str, read: Callable[[NDArray[np.int64]], NDArray[Any]]) -> NDArray[Any]:
        """Returns an array with one row per record, after reading the rows that it lacks."""
        known = len(self._grown[name].values) if name in self._grown else -1
        if known < len(self):
            return self._grow(name, read(np.arange(max(known, 0), len(self))), known)
        return self._grown[name].values

    def of_row(self, name: str, row: int) -> NDArray[Any]:
        """Returns one row of `spd`, `radar` or `depth`. Reads only this row, unless the array is
        cached or an iteration has read it."""
        if name in self._grown and row < len(self._grown[name].values):
            return np.asarray(getattr(self, name)[row])
        first, block = self._block or (row, self[[row]])
        if not 0 <= row - first < len(block):
            first, block = row, self[[row]]
        return np.asarray(getattr(block, name)[row - first])

    def follow(self, *, pause_s: float = 0.2) -> Iterator[int]:
        """Yields the row of each existing record and then of each new record, until the run is
        closed or its recorder has been killed. The arrays contain each yielded row, as in: for row
        in run.follow(): print(run.spd[row].sum())."""
        row = 0
        while True:
            ended = self.refresh().info["status"] != "open"
            while row < len(self):  # the caller may call refresh(), too
                yield row
                row += 1
            if ended:
                return
            time.sleep(pause_s)

    @errors_with_path
    def _read(self) -> None:
        layout = (self.axes, self.antennas, self.zones) if self.info else None
        with self._opened() as db:
            self.axes = axes_of(db, self.path)
            cursor = db.execute("SELECT *, CAST(ifnull(window_s, 0) AS REAL) AS window_s FROM run")
            self.info = dict(zip((column[0] for column in cursor.description), cursor.fetchone()))
            self.meta = meta_of(self.path, self.info.pop("meta"))
            self.info["status"] = status_of(db, self.path, self.info["status"])
            self.offset_m = offsets_of(db, self.path)
            self.antennas = antennas_of(db, self.path, self.axes.get("array"))
            self.zones = stored_zones(db)
            if "index" not in self._grown:
                self.index, self.labels = np.array([], np.int64), []
            rows = db.execute(
                "SELECT idx, CAST(ifnull(valid, 0) AS INTEGER), CAST(ifnull(label, '') AS TEXT), "
                "CAST(ifnull(slot_utc_ns, 0) AS INTEGER) FROM record WHERE idx > ? ORDER BY idx",
                self.index[-1:].tolist() or [NULL_INTEGER]).fetchall()
        if rows and not 0 <= rows[0][0] <= rows[-1][0] <= MAX_INDEX:
            raise ValueError(f"{self.path}: damaged: the records have numbers from {rows[0][0]} to "
                             f"{rows[-1][0]}; expected 0 to {MAX_INDEX}")
        if layout != (self.axes, self.antennas, self.zones):
            self._forget()
        index, bits, labels, utc = zip(*rows) if rows else ((), (), (), ())
        self.labels.extend(labels)
        self.time = self._grow("time", np.array(utc, "datetime64[ns]"))
        mask = np.array(bits, np.int64)
        self.valid = {name: self._grow(f"{name} is valid", (mask & bit) != 0)
                      for name, bit in SENSORS.items()}
        self.index = self._grow("index", np.array(index, np.int64))  # last: threads read its rows

    @contextmanager
    def _opened(self) -> Iterator[Connection]:
        """Opens the run file. Raises ValueError if it contains another run than before."""
        with closing(connect(self.path)) as db:
            if not (row := db.execute("SELECT uuid FROM run").fetchone()):
                raise ValueError(f"{self.path}: the run table is empty")
            if (uuid := row[0]) != self.info.get("uuid", uuid):
                raise ValueError(f"{self.path}: contains another run (UUID {uuid}, expected "
                                 f"{self.info['uuid']}); open it again")
            yield db

    @errors_with_path
    def select(self, sql: str, *values: Any) -> list[Any]:
        """Returns the result rows of an SQL query. Raises ValueError if the query is invalid."""
        with self._opened() as db:
            return query(db, self.path, sql, values)

    @errors_with_path
    def of_records(self, columns: str, rows: NDArray[np.int64] | None = None) -> list[Any]:
        """Returns the given columns of the table `record`, for the given rows or for all rows."""
        index = (self.index if rows is None else self.index[rows]).tolist()
        found = {row[0]: row[1:] for row in self.select(
            f"SELECT idx, {columns} FROM record WHERE idx IN (SELECT value FROM json_each(?))",
            json.dumps(index))}
        return [found[number] for number in index]

    def to_xarray(self) -> Any:
        """Returns the run as an xarray.Dataset (see netcdf.dataset)."""
        from .netcdf import dataset

        return dataset(self)

    def to_pandas(self) -> Any:
        """Returns a pandas.DataFrame (python3-pandas) with one row per record: time (UTC), label,
        NAME_valid for each sensor, and the columns of quality()."""
        import pandas

        valid = {f"{name}_valid": mask for name, mask in self.valid.items()}
        return pandas.DataFrame({"time": self.time, "label": self.labels} | valid | self.quality(),
                                pandas.Index(self.index, name="record"))

    @property
    def half_tangent(self) -> float:
        """Tangent (x / z) at the right edge of the maps."""
        axis = self.axes.get("map_x")
        return axis.step * axis.count / 2 if axis else 0.55

    @property
    def tables(self) -> list[str]:
        """Names of all tables in the run file."""
        names = self.select("SELECT name FROM sqlite_master WHERE type = 'table'")
        return sorted(name for (name,) in names if name not in STATISTICS)

    def table(self, name: str) -> dict[str, NDArray[Any]]:
        """Returns all columns of a table except blobs (see run_files.table)."""
        if name not in self.tables:
            raise ValueError(f"{self.path}: has no table {name!r}; see Run.tables")
        with self._opened() as db:
            return table(db, name)

    def events(self) -> list[tuple[str, str, str, str]]:
        """Returns the UTC time, level, source and text of each event."""
        return self.select("SELECT utc, level, source, text FROM event ORDER BY id")

    @errors_with_path
    def quality(self) -> dict[str, NDArray[Any]]:
        """Returns a dict of columns [n], with one value per record: length_s, and five columns for
        each sensor, e.g. spd_used, spd_lost, spd_verdict (the word of the verdict), spd_figures
        (its values) and spd_clock_residual_s."""
        count = "CAST(ifnull({}, 0) AS INTEGER)", int
        text = "CAST(ifnull({}, '') AS TEXT)", object
        kinds = {"used": count, "lost": count, "verdict": text, "figures": text,
                 "clock_residual_s": ("{}", float)}
        reads = {"length_s": ("(slot_end_ns - slot_start_ns) * 1e-9", float)} | {
            f"{s}_{name}": (sql.format(f"{s}_{name}"), kind)
            for s in SENSORS for name, (sql, kind) in kinds.items()}
        rows = self.of_records(", ".join(sql for sql, _ in reads.values()))
        return {name: np.array([row[k] for row in rows], kind)
                for k, (name, (_, kind)) in enumerate(reads.items())}

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        return f"<echofuse run {self.path}: {len(self)} records, {self.info['status']}>"

    def _repr_html_(self) -> str:
        """Returns a summary for notebooks, with one line per sensor."""
        cells = "".join(
            f"<tr><td>{name}</td><td>{mask.sum()} of {len(self)}</td><td>{axis.count} x "
            f"{axis.step:.4g} {html.escape(axis.unit)} from {axis.start:.4g}</td></tr>"
            for name, mask in self.valid.items()
            if (axis := self.axes.get("depth_x" if name == "depth" else name)))
        title = html.escape(f"{self.path.name}: {len(self)} records of "
                            f"{self.info['window_s']:g} s, {self.info['status']}")
        return (f"<b>{title}</b><table><tr><th>sensor</th><th>valid</th><th>axis</th></tr>"
                f"{cells}</table>")

    @property
    def spd(self) -> NDArray[np.uint32]:
        """Counts [n, bins], or [n, zones, bins] for a detector with zones. Read-only like all
        cached arrays."""
        table = read_only(self._cached("spd", lambda rows: self._vectors("spd", "<u4", 0, rows)))
        return table.reshape(len(self), len(self.zones), table.shape[1]
                             // len(self.zones)) if self.zones else table

    @property
    def radar(self) -> NDArray[np.float32]:
        """Linear power [n, bins], arbitrary unit."""
        return read_only(self._cached("radar", lambda rows: self._vectors(
            "radar", "<f4", np.nan, rows)).astype(np.float32, copy=False))

    @property
    def depth(self) -> NDArray[np.float32]:
        """z of each pixel of the camera images [n, rows, columns], m; NaN: no return."""
        size = self._image_size()
        return read_only(self._cached("depth", lambda rows: self._table(
            "depth", size, np.float32, np.nan, rows,
            lambda row, blob: METRES.take(inflated(blob, size), mode="clip"))))

    def _image_size(self) -> tuple[int, int]:
        rows, columns = (self.axes[name].count if name in self.axes else 0
                         for name in ("depth_y", "depth_x"))
        if rows * columns > MAX_PIXELS:
            raise ValueError(f"{self.path}: depth has {rows * columns} pixels; expected at most "
                             f"{MAX_PIXELS}")
        return rows, columns

    @errors_with_path
    def depth_mm(self, row: int) -> NDArray[np.uint16]:
        """Returns the camera image of one record [rows, columns], mm, 0: no return."""
        images = dict(self._images(rows_of(len(self), [row])))
        return next(iter(images.values()), np.zeros(self._image_size(), np.uint16))

    @errors_with_path
    def maps(self, rows: ArrayLike | None = None) -> NDArray[np.float32]:
        """Returns the ground-truth maps [n, N, N] of the given rows, or of all rows (read-only), on
        the map grid of the models: z, m; NaN: no return or no depth image. Maps are cached."""
        selected = rows_of(len(self), slice(None) if rows is None else rows)
        shape = [len(cells) for cells in reversed(self._cells)]
        maps = self._cached("map", lambda new: np.full((len(new), *shape), np.nan, np.float32))
        known = self._cached("map is known", lambda new: np.zeros(len(new), bool))
        new = np.unique(selected[~known[selected]])
        to_z = self.axes.get("map_z")
        convert = grid.to_map(*self._cells, self._image_size(), to_z.step if to_z else 6.0)
        for row, image in self._images(new):
            maps[row] = convert(image)
        known[new] = True
        return read_only(maps) if rows is None else maps[selected]

    def map_of(self, row: int) -> NDArray[np.float32]:
        """Returns the ground-truth map of one record [N, N], as in maps()."""
        return np.asarray(self.maps([row])[0])

    def _images(self, rows: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.uint16]]]:
        """For each of the given rows that has a depth image, yields the row and the image, mm."""
        size = self._image_size()
        return ((row, inflated(blob, size)) for row, blob in self._blobs("depth", rows))

    @cached_property
    def _cells(self) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Interval of camera columns for each map column, and of camera rows for each map row."""
        x, y = (self.axes.get(name) for name in ("depth_x", "depth_y"))
        to_x, to_y = (self.axes.get(name) for name in ("map_x", "map_y"))
        if x is None or y is None:
            raise ValueError(f"{self.path}: the run has no depth camera")
        half, size = self.half_tangent, to_x.count if to_x else 64
        return (grid.cells(x, to_x or tangents("map_x", size, half)),
                grid.cells(y, to_y or tangents("map_y", size, half)))

    # photons(), power() and lags() are the inputs of the method (recon/README.md).
    @errors_with_path
    def photons(self) -> NDArray[np.float32]:
        """Returns counts >= 0 [n, bins] or [n, zones, bins] without pile-up and range bias."""
        table, axis = self.spd.astype(np.float32), self.axes.get("spd")
        if axis is None:
            return table
        zeros_ps = [zone.zero_ps for zone in self.zones] or [0.0]
        parts = table.reshape(len(self), len(zeros_ps), axis.count)  # `parts` is a view of `table`
        if self.meta.get("detector_dead_time_ps") is not None:
            for part, clicks in zip(parts, pile_up.clicks_of(self)):
                part[:] = [pile_up.corrected(self, row, *clicks) for row in part]
        offset_ps = self.offset_m.get("spd", 0) * PS_PER_M
        for k, zero_ps in enumerate(zeros_ps):
            parts[:, k] = shifted(parts[:, k], (offset_ps + zero_ps) / axis.step).clip(0)
        return table

    @errors_with_path
    def power(self, range_offset_m: float = 0) -> NDArray[np.float32]:
        """Returns linear power [n, points] at true ranges; 0 if the radar is missing. If the power
        includes the receiver noise, the median of each profile is subtracted."""
        if "radar" not in self.axes:
            return np.zeros((len(self), 0), np.float32)
        power = np.nan_to_num(self.radar)
        if self.axes["radar"].quantity == "power_with_noise":
            power = power - np.sort(power, axis=1)[:, power.shape[1] // 2, None]
        return shifted(power, self._bias_m(range_offset_m) / self.axes["radar"].step)

    @property
    def power_axis(self) -> Axis | None:
        """Range axis of power()."""
        axis = self.axes.get("radar")
        return (replace(axis, quantity="power")
                if axis and axis.quantity == "power_with_noise" else axis)

    @cached_property
    def lags_axis(self) -> Axis | None:
        """Axis of lags() (recon/data/lags.hpp); None if the run has no antenna lags."""
        return antenna_lags.axis_of(self.axes.get("array"), self._pairs)

    @errors_with_path
    def lags(self, range_offset_m: float = 0) -> NDArray[np.float32]:
        """Returns antenna lags [n, points, 2 D + 1] at true ranges: the power, then the real and
        imaginary parts of the mean correlation at each antenna spacing."""
        axis = self.lags_axis
        if axis is None:
            return np.zeros((len(self), 0, 1), np.float32)
        out = np.zeros((len(self), axis.count, 1 + 2 * int(axis.scale)))
        for row, bins in self.array_bins():
            out[row] = antenna_lags.of_bins(bins, self.antennas, self._pairs)
        return shifted(out.astype(np.float32), self._bias_m(range_offset_m) / axis.step)

    def _bias_m(self, m: float) -> float:
        m = number("range_offset_m", m, limits=RANGE_OFFSET_M)
        return m + self.offset_m.get("radar", 0)

    def array_bins(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """For each row with antenna samples, yields the row and its bins (radar_array.hpp): the
        power, and integers relative to this power. Raises ValueError if a bin is invalid."""
        axis, blobs = self.axes["array"], dict(self.of_records("idx, array"))
        count = int(axis.scale)
        stored = np.dtype([("power", "<f4"), ("values", "<i2", count * (count + 2) + 2)])
        for row in np.flatnonzero(self.valid["radar"]).tolist():
            blob = blobs.get(int(self.index[row]))
            if not blob:
                continue
            place = f"{self.path}: record {self.index[row]}: array"
            if len(blob) != (size := axis.count * stored.itemsize):
                raise ValueError(f"{place} has {len(blob)} bytes, but its axis requires {size}")
            found = np.frombuffer(blob, stored)
            if bad := np.flatnonzero(~(np.isfinite(found["power"])
                                       & (found["power"] >= 0))).tolist():
                raise ValueError(f"{place} bin {bad[0]}: the power is negative or not finite")
            yield row, found

    @cached_property
    def _pairs(self) -> tuple[antenna_lags.Pairs, antenna_lags.Pairs]:
        return antenna_lags.pairs_of(self.antennas)

    def _blobs(self, sensor: str, rows: NDArray[np.int64]) -> Iterator[tuple[int, bytes]]:
        """For each of the given rows that is valid, yields the row and the blob."""
        rows = rows[self.valid[sensor][rows]]
        rows = rows[np.argsort(self.index[rows], kind="stable")]
        index, stored, blob = self.index[rows].tolist(), None, None
        with self._opened() as db:
            found = db.execute(f"SELECT idx, CAST({sensor} AS BLOB) FROM record WHERE idx IN "
                               "(SELECT value FROM json_each(?)) ORDER BY idx", [json.dumps(index)])
            for row, number in zip(rows.tolist(), index):
                if number != stored:
                    stored, blob = next(found, (None, None))
                if number != stored:
                    raise ValueError(f"{self.path}: record {number} is missing")
                yield row, blob or b""

    def _vectors(self, sensor: str, kind: str, missing: float,
                 rows: NDArray[np.int64]) -> NDArray[Any]:
        """Reads the histograms or range profiles of consecutive rows."""
        count = self.axes[sensor].count if sensor in self.axes else 0
        count *= (len(self.zones) or 1) if sensor == "spd" else 1
        size = count * np.dtype(kind).itemsize

        def vector(row: int, blob: bytes) -> NDArray[Any]:
            if len(blob) != size:
                raise ValueError(f"{self.path}: record {self.index[row]}: {sensor} has {len(blob)} "
                                 f"bytes, but its axis requires {size}")
            return np.frombuffer(blob, kind)

        return self._table(sensor, (count,), kind, missing, rows, vector)

    @errors_with_path
    def _table(self, sensor: str, shape: tuple[int, ...], kind: Any, missing: float,
               rows: NDArray[np.int64],
               decode: Callable[[int, bytes], NDArray[Any]]) -> NDArray[Any]:
        """Reads the values of consecutive rows. `missing` stands for missing values."""
        out, first = None, int(rows[0]) if len(rows) else 0
        for row, blob in self._blobs(sensor, rows):
            values = decode(row, blob)
            if out is None:  # allocated after the first check, because the axis may be damaged
                out = np.empty((len(rows), *shape), kind)
            out[row - first] = values
        if out is None:
            return np.full((len(rows), *shape), missing, kind)
        out[~self.valid[sensor][rows]] = missing
        return out
