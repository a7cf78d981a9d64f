# SPDX-License-Identifier: MIT
"""Exports a run to HDF5 (h5py) or netCDF (xarray), or one record to CSV.

The HDF5 file has a NeXus-like layout. Every array has units, and every dimension has a scale. The
file contains n records in the same order as the run, in this layout:
  /entry               title, entry_identifier, start_time, end_time, configuration, radar_cfg
  /entry/data          names and units as in to_xarray(): spd u32 [n, bins] or [n, zones, bins];
                       radar f32 [n, bins] linear power; depth f32 [n, rows, columns] m; array f32
                       [n, bins, values] of the radar antennas
                       (acquire/measurement/radar_array.hpp), array_frames u64 [n]; axes spd_time
                       (ps, start of each bin), radar_range, array_range (m),
                       depth_x, depth_y (tangents); record, time i64 [n] (ns); label;
                       SENSOR_valid u8, SENSOR_used, SENSOR_lost u64, SENSOR_verdict,
                       SENSOR_figures
  /entry/SENSOR        NXdata group for each of these arrays
  /entry/instrument/SENSOR   address, model, serial, firmware
  /entry/tables/TABLE  columns of the run file: i64 with `missing_value`, f64 with NaN, or text; the
                       scale is the first column, or `row` if the first column contains text
If a sensor is invalid in a record, spd contains zeros, and radar, array and depth contain NaN.
The netCDF file contains the data set that to_xarray() returns."""
from __future__ import annotations

import argparse
import importlib
import os
import pathlib
import re
import sqlite3
import sys
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np

from .. import __version__, runs
from ..runs import antennas, netcdf
from ..runs.batches import Progress, blocks, marked
from ..runs.netcdf import SINCE_1970
from ..runs.programs import EXIT_CODES
from ..runs.run import SENSORS, Run
from ..runs.run_files import NULL_INTEGER
from ..runs.staged import staged, stop_by_signal
from . import record_csv

__all__ = ["export", "main"]

OF_THE_MACHINE = {"units": "ns",
                  "long_name": "time since the start of the machine (CLOCK_MONOTONIC)"}
UNITS = {"db": "dB", "ps": "ps", "ns": "ns", "us": "us", "ms": "ms", "s": "s", "m": "m",
         "rad": "rad", "ppm": "1e-6", "percent": "%", "c": "degC"}
ARRAY = ("for each range bin, over the frames of a record: mean sample of each antenna (real, "
         "imaginary); power of each antenna; mean of x_m conj(x_n) for m < n, row by row; mean of "
         "sum_m x_m(t) conj(x_m(t-1)); antennas as in /entry/tables/antenna")
# NAME: (axes after the record axis, unit, meaning, function that returns the values)
SIGNALS: dict[str, tuple[list[str], str, str, Callable[[Run], Any]]] = {
    "spd": (["spd_time"], "counts", netcdf.LONG_NAMES["spd"], lambda part: part.spd),
    "radar": (["radar_range"], "1", netcdf.LONG_NAMES["radar"], lambda part: part.radar),
    "array": (["array_range", "array_value"],
              "units of the firmware integers, squared for powers", ARRAY, antennas.values),
    "depth": (["depth_y", "depth_x"], "m", netcdf.LONG_NAMES["depth"], lambda part: part.depth)}
# name in /entry: column of the table `run` that is stored there
TEXTS = {"title": "notes", "entry_identifier": "uuid", "start_time": "started_utc",
         "end_time": "ended_utc", "status": "status",
         "operator": "operator", "configuration": "config_resolved", "radar_cfg": "radar_cfg"}
AXES = netcdf.AXES | {"array_range": "array"}


def units_of(table: str, column: str) -> str:
    """Returns the units of a column, derived from the suffix of its name; "1" for counts, flags and
    ratios."""
    if table in ("antenna", "axis") and column in ("x", "y", "start", "step"):
        return ("half wavelengths" if table == "antenna"
                else "given in the column unit of the same row")
    if column.endswith("utc_ns"):
        return SINCE_1970
    return UNITS.get(column.rpartition("_")[2],
                     "1") if "_" in column and "over_150_ms" not in column else "1"


def put(group: Any, name: str, values: Any, scale: Any = None, **attributes: Any) -> Any:
    """Creates a data set from a column or a string and returns it. Strings have a fixed length,
    which all readers support. They are ASCII if possible, for readers such as Octave. If `scale` is
    not given, the column itself becomes a dimension scale."""
    import h5py

    values = np.array(values.encode("utf-8", "surrogateescape") if isinstance(values, str)
                      else values)
    if values.dtype.kind == "S":
        coding = "utf-8" if (np.frombuffer(values.tobytes(), np.uint8) > 127).any() else "ascii"
        values = values.astype(h5py.string_dtype(coding, max(values.dtype.itemsize, 1)))
        attributes |= {"_Encoding": "utf-8"} if values.ndim else {}
    data_set = group.create_dataset(name, data=values)
    data_set.attrs.update(attributes)
    if values.ndim and scale is None:
        data_set.make_scale(name)
    attach(data_set, [scale or data_set] if values.ndim else [])
    return data_set


def attach(data_set: Any, scales: list[Any]) -> None:
    """Attaches a scale to each dimension of a data set."""
    for at, scale in enumerate(scales):
        if scale != data_set:
            data_set.dims[at].attach_scale(scale)
            data_set.dims[at].label = scale.name.rpartition("/")[2]


def write_head(entry: Any, run: Run, tables: dict[str, dict[str, Any]]) -> None:
    """Writes the metadata of the run, of its devices and of their calibration."""
    entry.parent.attrs["default"] = "entry"
    entry.attrs.update({"NX_class": "NXentry", "default": "data"})
    for name, key in TEXTS.items():
        put(entry, name, str(run.info[key] or ""))
    put(entry, "program_name", f"echofuse {run.info['version']}")
    # If a device was reconnected, it has several rows, and only the first is written.
    # The ranges in the file are measured ranges: true range = measured range - offset_m.
    for sensor, (table, group) in ((s, t) for s in SENSORS for t in (("device", "instrument/"),
                                             ("calibration", "calibration_"))):
        columns = tables.get(table, {})
        for row in np.flatnonzero(columns.get("sensor", np.array([])) == sensor.encode())[:1]:
            facts = {name: values[row] for name, values in columns.items()
                     if name not in ("sensor", "policy")}
            target = entry.require_group(group + sensor)
            if table == "calibration":
                target.attrs.update({name: value.decode() if isinstance(value, bytes) else value
                                     for name, value in facts.items()})
                continue
            target.attrs["NX_class"] = "NXdetector"
            for name, value in facts.items():
                put(target, name, value)


def make_signals(entry: Any, run: Run) -> list[str]:
    """For each sensor of the run, creates an empty array with axes, and an NXdata group. Returns
    the names of the arrays."""
    data, axes = entry["data"], {name: axis for name, axis in run.axes.items() if axis.count > 0}
    for name, axis in ((name, axes[key]) for name, key in AXES.items() if key in axes):
        put(data, name, axis.values, units=axis.unit,
            quantity=axis.quantity).attrs["scale"] = axis.scale
    if "array" in axes:
        put(data, "array_value", np.arange(int(axes["array"].scale + 1) ** 2 + 1))
    signals = [name for name, (axis_names, *_) in SIGNALS.items()
               if all(axis in data for axis in axis_names)]
    if run.zones:
        put(data, "zone", np.arange(len(run.zones)))
    spd_axes = ["zone"] * bool(run.zones) + ["spd_time"]
    for name in signals:
        axis_names, units, meaning, _ = SIGNALS[name]
        axis_names = spd_axes if name == "spd" else axis_names
        if name == "radar":
            meaning += {"binned_power": ", summed over one step around each point",
                        "power_with_noise": ", including the receiver noise"
                        }.get(axes["radar"].quantity, "")
        scales = [data[axis] for axis in ("record", *axis_names)]
        shape = tuple(len(scale) for scale in scales)
        line = int(np.prod(shape[2:])) * 4
        layout: dict[str, Any] = {"dtype":
                                  "u4"} if name == "spd" else {"dtype": "f4", "fillvalue": np.nan}
        if shape[0] and line * shape[1] >= 64:  # compression would enlarge smaller records
            layout |= {"chunks": (1, min(max((16 << 20) // line, 1), shape[1]), *shape[2:]),
                       "shuffle": True, "compression": 1}
        data.create_dataset(name, shape,
                            **layout).attrs.update({"units": units, "long_name": meaning})
        attach(data[name], scales)
        group = entry.create_group(name)
        for member in ("record", *axis_names, name):
            group[member] = data[member]
        group.attrs.update({"NX_class": "NXdata", "signal": name, "axes": ["record", *axis_names]})
    data.attrs.update({"NX_class": "NXdata", "signal": "spd"}
                      | ({"axes": ["record", *spd_axes]} if "spd" in signals else {}))
    return signals


def write_h5(run: Run, path: pathlib.Path, progress: Progress) -> int:
    """Writes the run as HDF5 and returns the number of unreadable records."""
    import h5py

    with h5py.File(path, "w") as file:
        tables = {name: run.table(name) for name in run.tables}
        places = np.searchsorted(tables["record"]["idx"], run.index)
        record = {name: values[places] for name, values in tables["record"].items()}
        entry = file.create_group("entry")
        data = entry.create_group("data")
        index = put(data, "record", run.index, units="1")
        write_head(entry, run, tables)
        signals = make_signals(entry, run)
        unreadable: dict[int, bytes] = {}
        valid = {sensor: np.zeros(len(run), np.uint8) for sensor in SENSORS}
        for first, part, faults in blocks(run, progress):
            last = first + len(part)
            unreadable |= {first + row: fault.encode() for row, fault in faults.items()}
            for sensor, mask in part.valid.items():
                valid[sensor][first:last] = mask
            for name in signals:
                if part.valid[name if name in SENSORS else "radar"].any():
                    data[name][first:last] = SIGNALS[name][-1](part)
        put(data, "time", record["slot_utc_ns"], index, units=SINCE_1970)
        put(data, "label", record["label"], index)
        if "array" in signals:
            put(data, "array_frames", antennas.frames(run), index, units="1")
        for sensor in SENSORS:
            put(data, f"{sensor}_valid", valid[sensor], index, units="1")
            for name in f"{sensor}_used", f"{sensor}_lost":
                put(data, name, record[name].astype("u8"), index, units="1")
            for name in "verdict", "figures":
                texts = marked(record[f"{sensor}_{name}"], unreadable if name == "verdict" else {})
                put(data, f"{sensor}_{name}", np.array(texts, "S"), index)
        for table, columns in tables.items():
            group, key = entry.require_group(f"tables/{table}"), next(iter(columns.values()))
            scale = put(group, "row", np.arange(len(key))) if key.dtype.kind == "S" else None
            for name, values in columns.items():
                more: dict[str, Any] = {}
                if values.dtype.kind != "S":
                    more = {"units": units_of(table, name)}
                if name == "mono_ns" or (table == "record" and more.get("units") == "ns"):
                    more = OF_THE_MACHINE
                if values.dtype.kind == "i" and (values == NULL_INTEGER).any():
                    more = more | {"missing_value": np.int64(NULL_INTEGER)}
                column = put(group, name, values, scale, **more)
                scale = scale or column
    return len(unreadable)


def export(run: Run, place: pathlib.Path, record: int | None = None,
           progress: Progress = lambda done: None) -> int:
    """Writes the run to NAME.h5 or NAME.nc, or one record to NAME.csv. Returns the number of
    unreadable records. Raises FileExistsError if the file exists, ValueError if the record is
    missing or damaged, ImportError if a library is missing, and OSError if the disk is full."""
    for module in {".h5": ["h5py"], ".nc": ["xarray", netcdf.engine()]}.get(place.suffix, []):
        try:
            importlib.import_module(module)
        except ImportError:
            raise ImportError(
                f"{place}: requires python3-{module} (apt-get install python3-{module})") from None
    with staged(place) as path:
        if record is not None:
            return record_csv.write(run, record, path)
        return (write_h5 if place.suffix == ".h5" else netcdf.write)(run, path, progress)


def main() -> None:
    """Runs echofuse-export with the arguments in sys.argv."""
    parser = argparse.ArgumentParser(
        prog="echofuse-export", formatter_class=argparse.RawDescriptionHelpFormatter,
        description="export a run to HDF5 or netCDF, or one record to CSV",
        epilog=f"{EXIT_CODES}5 some records are unreadable, 6 disk, 130 interrupted")
    parser.add_argument("--version", action="version", version=f"echofuse-export {__version__}",
                        help="print the version and exit")
    parser.add_argument("run", metavar="RUN", help="run file")
    parser.add_argument("--to", required=True, type=pathlib.Path, metavar="FILE",
                        help="file to write: NAME.h5 or NAME.nc; with --record, NAME.csv")
    parser.add_argument("--record", type=int, metavar="INDEX",
                        help="export only the record with this index, as CSV")
    parser.add_argument("-q", "--quiet", action="store_true", help="do not print the progress")
    args = parser.parse_args()
    if args.to.suffix not in ((".h5", ".nc") if args.record is None else (".csv",)):
        parser.error(f"--to {args.to}: expected NAME.h5 or NAME.nc, or NAME.csv with --record N")
    stopped = stop_by_signal()
    warnings.showwarning = lambda message, *_: print(f"echofuse-export: {message}", file=sys.stderr)

    def end(code: int, text: str) -> NoReturn:
        """Prints a message and exits without finalising the interpreter. During finalisation, HDF5
        would try again to write to the full disk, and crash."""
        print(f"echofuse-export: {text}", file=sys.stderr, flush=True)
        os._exit(code)

    def print_progress(done: int) -> None:
        if sys.stderr.isatty() and not args.quiet:
            print(f"\rexport {done}/{len(run)} ", end="" if done < len(run) else "\n",
                  file=sys.stderr)

    sys.excepthook = lambda *_: None  # hides errors that HDF5 objects print when they are deleted
    sys.unraisablehook = lambda _: None
    try:
        try:
            run = runs.open(args.run)
        except OSError as error:
            end(1, str(error))
        bad = export(run, args.to, args.record, print_progress)
    except (KeyboardInterrupt, Exception) as error:
        if stopped:
            end(130, "interrupted; no file was written")
        if isinstance(error, (OSError, RuntimeError)) and not isinstance(
                                  error, (FileExistsError, BlockingIOError)):
            number = getattr(error, "errno",
                             None) or int((re.findall(r"errno = (\d+)", str(error)) or "0")[0])
            end(6, f"{args.to}: cannot write ({os.strerror(number) if number else error})")
        end(1, f"{args.run}: {error}"
            if isinstance(error, (sqlite3.Error, TypeError, OverflowError)) else str(error))
    if bad:
        end(5, f"{bad} records are unreadable; {args.to} marks them as unreadable")
