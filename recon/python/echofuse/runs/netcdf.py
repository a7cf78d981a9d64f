# SPDX-License-Identifier: MIT
"""Converts a run to an xarray.Dataset (python3-xarray) and to netCDF (python3-h5netcdf)."""
from __future__ import annotations

import importlib.util
import os
import pathlib
from typing import Any

import numpy as np

from .batches import Progress, blocks, marked
from .run import PS_PER_M, SENSORS, Run
from .zones import Zone

__all__ = ["AXES", "LONG_NAMES", "SINCE_1970", "dataset", "engine", "write"]

SINCE_1970 = "nanoseconds since 1970-01-01T00:00:00Z"  # unit of times in xarray and netCDF
ONE = {"units": "1"}
# axis of the run, by dimension
AXES = {"spd_time": "spd", "radar_range": "radar", "depth_y": "depth_y", "depth_x": "depth_x"}
HEAD_BYTES = 200_000  # more than the size of a file with one record, 87 kB
# names of attributes that the netCDF libraries use themselves
RESERVED = {"CLASS", "DIMENSION_LIST", "NAME", "REFERENCE_LIST", "_NCProperties",
            "_Netcdf4Coordinates", "_Netcdf4Dimid", "_nc3_strict"}
LONG_NAMES = {"spd": "detections per bin of two-way time of flight",
    "radar": "linear power on an arbitrary scale", "depth": "z of each pixel, NaN: no return",
    "record": "number of the record", "time": "start of the slot", "label": "label of the record",
    "spd_time": "two-way time at the start of the bin",
    "spd_range": "measured range at the start of the bin",
    "radar_range": "measured range of the point",
    "depth_x": "tangent of the pixel, positive to the right",
    "depth_y": "tangent of the pixel, positive upwards", "zone_x": "tangent of the zone centre, "
    "positive to the right", "zone_y": "tangent of the zone centre, positive upwards",
    "zone_width": "full width of the zone, tangent", "zone_zero_ps": "two-way time of range 0",
    "event": "level, source and text of the event", "event_utc": "time of the event",
    "antenna": "place, gain and phase of each virtual antenna",
    "antenna_column": "meaning of the column"}


def dataset(run: Run) -> Any:
    """Returns the run as an xarray.Dataset (python3-xarray), with the names and units of
    /entry/data in HDF5 files of echofuse-export. spd_range and radar_range are measured ranges, m.
    The offsets to subtract from them are attributes of the data set."""
    import xarray

    columns = {"verdict": "verdict", "figures": "figures of the verdict",
               "used": "number of tags, histograms or frames used",
               "lost": "number of tags, histograms or frames lost"}
    quality, events = run.quality(), run.events()
    coords: dict[str, Any] = {"record": ("record", run.index, ONE), "time": ("record", run.time),
                              "label": ("record", run.labels)}
    data: dict[str, Any] = {}
    of_zone = ("zone",) if run.zones else ()
    dims_of = {"spd": (*of_zone, "spd_time"), "radar": ("radar_range",),
               "depth": ("depth_y", "depth_x")}
    unit = {"spd": "counts", "radar": "1", "depth": "m"}
    for sensor, dims in dims_of.items():
        if not all(AXES[dim] in run.axes for dim in dims if dim != "zone"):
            continue
        data[sensor] = (("record", *dims), getattr(run, sensor), {"units": unit[sensor]})
        coords[f"{sensor}_valid"] = ("record", run.valid[sensor], ONE)
        for column in columns:
            coords[f"{sensor}_{column}"] = ("record", quality[f"{sensor}_{column}"],
                                            ONE if column in ("used", "lost") else {})
        for dim in filter(AXES.get, dims):
            axis = run.axes[AXES[dim]]
            coords[dim] = (dim, axis.values, {"units": axis.unit})
    if "spd" in data:
        coords["spd_range"] = ("spd_time", run.axes["spd"].values / PS_PER_M, {"units": "m"})
    for place, column in enumerate(Zone._fields if run.zones else ()):
        coords[f"zone_{column}"] = ("zone", [zone[place] for zone in run.zones],
                                    {"units": "ps"} if column == "zero_ps" else ONE)
    if events:
        data["event"] = ("event_row", [" ".join(map(str, row[1:])) for row in events])
        coords["event_utc"] = ("event_row", [row[0] for row in events])
    if run.antennas:
        data["antenna"] = (("antenna_row", "antenna_column"), np.array(run.antennas, float))
        coords["antenna_column"] = ["x_half_wavelengths", "y_half_wavelengths", "gain", "phase_rad"]
    out = xarray.Dataset(data, coords, attributes_of(run))
    for name, variable in out.variables.items():
        sensor, _, column = str(name).partition("_")
        variable.attrs["long_name"] = LONG_NAMES.get(
            str(name), f"{columns.get(column, 'whether the data are valid')}, {sensor}")
    return out


def attributes_of(run: Run) -> dict[str, Any]:
    """Returns the facts of the run and its metadata, by name. Texts of numbers become numbers. The
    facts replace metadata of the same name."""
    facts: dict[str, Any] = {"Conventions": "CF-1.8"} | {
        key: value if isinstance(value, float) else str(value) for key, value in run.info.items()}
    facts |= {f"{sensor}_offset_m": m for sensor, m in run.offset_m.items()}
    out: dict[str, Any] = {}
    for key, text in run.meta.items():
        value, _, error = map(number, str(text).partition(" +- "))
        if key in [f"{sensor}_offset_m" for sensor in SENSORS]:
            continue
        if isinstance(error, float) and not isinstance(value, str):
            out |= {key: value, f"{key}_standard_error": error}
        else:
            out[key] = number(str(text))
    return out | facts


def number(text: str) -> Any:
    """Returns the number or the numbers that a text states in their shortest form; otherwise the
    text."""
    try:
        values = [float(word) for word in text.split(" ")]
    except ValueError:
        return text
    if [f"{value:.15g}" for value in values] != text.split(" ") or not np.isfinite(values).all():
        return text
    return values[0] if len(values) == 1 else np.array(values)


def plain_text(value: Any) -> Any:
    """Replaces the characters of a text that netCDF cannot store."""
    return (value.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")
            if isinstance(value, str) else value)


def storable(data: Any) -> Any:
    """Replaces the attributes and texts of a data set that netCDF cannot store."""
    data.attrs = {plain_text(key): plain_text(value) for key, value in data.attrs.items()
                  if key and key not in RESERVED}
    for name in ("label", "event", "event_utc", *(f"{s}_{c}" for s in SENSORS
                                                  for c in ("verdict", "figures"))):
        if name in data:
            texts = np.array([plain_text(text) for text in data[name].values], object)
            data[name] = data[name].dims, texts, data[name].attrs
    return data


def engine() -> str:
    """Returns the module for netCDF-4 output: h5netcdf, or netCDF4 if only netCDF4 is installed."""
    h5netcdf, netcdf4 = (importlib.util.find_spec(name) for name in ("h5netcdf", "netCDF4"))
    return "netCDF4" if netcdf4 and not h5netcdf else "h5netcdf"


def require_space(path: pathlib.Path, size: int) -> None:
    """Empties a file. Raises OSError if the disk has no space for `size` bytes: HDF5 1.14 crashes
    if the disk becomes full while h5netcdf creates a variable."""
    if hasattr(os, "posix_fallocate"):
        with path.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
            file.truncate(0)


def write(run: Run, path: pathlib.Path, progress: Progress) -> int:
    """Writes the first block of records with xarray, and appends all further blocks with the same
    encoding. Returns the number of unreadable records."""
    import h5py
    from xarray import conventions

    encoded: Any = conventions.cf_encoder  # xarray does not declare the type of this function

    unreadable = 0
    for first, part, faults in blocks(run, progress):
        unreadable += len(faults)
        data = dataset(part)
        for name in (f"{sensor}_verdict" for sensor in SENSORS if f"{sensor}_verdict" in data):
            data[name] = ("record", np.array(marked(data[name].values, faults), object),
                          data[name].attrs)
        data = storable(data)
        data["time"].encoding = {"units": SINCE_1970, "dtype": np.int64}
        if first == 0:
            layout = {"zlib": True, "complevel": 1, "shuffle": True}
            encoding: dict[str, dict[str, Any]] = {
                name: layout | {"chunksizes": (1, *data[name].shape[1:])}
                for name in SENSORS if name in data}
            encoding |= {name: {"_FillValue": None} for name, values in data.coords.items()
                         if values.dtype.kind == "f"}
            require_space(path, data.nbytes + HEAD_BYTES)
            data.to_netcdf(path, engine=engine().lower(), unlimited_dims=["record"],
                           encoding=encoding)
            continue
        of_records = {name: values for name, values in data.variables.items()
                      if values.dims[:1] == ("record",)}
        with h5py.File(path, "a") as file:
            for name, values in encoded(of_records, {})[0].items():
                file[name].resize(first + len(part), 0)
                file[name][first:] = values.values
    return unreadable
