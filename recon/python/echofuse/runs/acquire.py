# SPDX-License-Identifier: MIT
"""Records runs and imports arrays with the program echofuse-acquire."""
from __future__ import annotations

import errno
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import run as runs
from .arguments import entries, listed, number, plain, text_of
from .programs import ProgramError, call, not_started, path_of

__all__ = ["annotate", "import_arrays", "record", "write_run"]

Path = str | os.PathLike[str]


def acquire_program(program: str | None) -> str:
    """Returns the path of echofuse-acquire: `program`, $ECHOFUSE_ACQUIRE, or the file in the folder
    of the other echofuse programs. Raises UsageError if the program is missing."""
    path = str(program or os.environ.get("ECHOFUSE_ACQUIRE") or path_of("echofuse-acquire"))
    if not shutil.which(path):
        raise not_started(path, "program not found")
    return path


def toml(value: Any) -> str:
    """Formats numbers, strings, paths and sequences, also those of NumPy, as TOML."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, (bool, int, float)):
        return repr(value).lower()
    return json.dumps(os.fspath(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def vectors(name: str, values: Any) -> list[str]:
    """Formats vectors of numbers for run.toml."""
    return [" ".join(repr(number(name, value)) for value in listed(name, vector))
            for vector in listed(name, values)]


def new_path(out: Path) -> pathlib.Path:
    """Returns the absolute path of a new run file, with its suffix. No part of the name is
    expanded. Raises ValueError if the path names a folder."""
    if os.path.basename(os.fspath(out)) in ("", ".", ".."):
        raise ValueError(f"{os.fspath(out)!r}: expected the name of a run file")
    path = pathlib.Path(out).absolute()
    return path if path.suffix == ".sqlite" else path.with_name(f"{path.name}.sqlite")


def out_option(out: Path) -> list[str]:
    """Returns the option --out, in which %% is a percent sign instead of a time field."""
    return ["--out", str(new_path(out)).replace("%", "%%")]


def annotate(run: runs.Run | Path, text: str | None = None, *, label: Any = None,
             program: str | None = None) -> None:
    """Adds a note to a run, or sets the label of a run in progress from its current slot on.
    Raises RuntimeError with the program's error message if the program fails."""
    if (text is None) == (label is None):
        raise ValueError("annotate: expected either `text` or `label`")
    path = pathlib.Path(run.path if isinstance(run, runs.Run) else run).absolute()
    if isinstance(run, runs.Run):
        run.events()  # checks that the file still contains this run
    if label is None:
        arguments = ["--", text_of("text", text)]
    else:
        label = text_of("label", label)
        arguments = [f"--label={label}"] if label else ["--label", ""]
    call(acquire_program(program), "annotate", path, *arguments)


def record(config: Path | None = None, count: int = 1, *, label: Any = None,
           out: Path | None = None, settings: dict[str, Any] | None = None,
           program: str | None = None) -> runs.Run:
    """Records `count` slots and returns the closed run. `settings` override the configuration, e.g.
    {"run.window_s": 1.0, "radar.keep_running": True}. `program` is the path of echofuse-acquire
    (default: $ECHOFUSE_ACQUIRE). Raises RuntimeError with the program's error message if the
    program fails. Ctrl-C ends the run after the current slot."""
    words = [acquire_program(program), "run", "--json", "-q",
             "--count", str(number("count", count, int))]
    words += out_option(out) if out is not None else []
    words += ["--config", os.fspath(config)] if config is not None else []
    words += ["--set", f"run.label={toml(text_of('label', label))}"] if label is not None else []
    for key, value in entries("settings", settings):
        try:
            words += ["--set", f"{key}={value if isinstance(value, str) else toml(value)}"]
        except TypeError:
            raise ValueError(f"settings[{key!r}]: {value!r} (expected a number, text or a "
                             "sequence)") from None
    files: list[str] = []
    # The child has its own session, so that Ctrl-C reaches it only through send_signal() below.
    with tempfile.TemporaryFile("w+") as errors, subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=errors, text=True,
            start_new_session=True) as child:
        try:
            files = [event["file"] for event in map(json.loads, child.stdout or ())
                     if event["event"] == "run"]
        except KeyboardInterrupt:
            child.send_signal(signal.SIGINT)
            child.communicate()
            raise
        finally:
            child.wait()
            errors.seek(0)
            message = errors.read()
    if child.returncode or not files:
        raise RuntimeError(message.strip()
                           or f"echofuse-acquire ended with exit code {child.returncode}")
    return runs.open(files[-1])


def write_run(path: Path, *, spd: ArrayLike | None = None, first_bin_ps: float = 0,
              bin_width_ps: float = 100, zones: Iterable[Iterable[float]] = (),
              irf_fwhm_ps: float = 0, radar: ArrayLike | None = None, first_m: float = 0,
              step_m: float = 0.25, radar_cell_m: float = 0, radar_taps: Iterable[float] = (),
              array: ArrayLike | None = None, array_frames: int = 1,
              antennas: Iterable[Iterable[float]] = (), depth_m: ArrayLike | None = None,
              half_tangent: float = 0.55,
              far_m: float = 6, map_size: int = 0, window_s: float = 3, began: str = "",
              label: Any = "", labels: Iterable[Any] = (),
              notes: str = "", signal: dict[str, float] | None = None,
              program: str | None = None) -> runs.Run:
    """Writes arrays as a run with `echofuse-acquire import`, and opens the run. A row means a
    missing sensor if all its values are NaN, masked or None. Raises ValueError if an argument is
    not an array of numbers or is masked in part, and RuntimeError with the program's error message
    if the import fails.

    path: file of the run; its name is used as given. spd: integer counts [n, bins], or [n, zones,
    bins] with `zones` as in Run.zones. first_bin_ps: two-way time at the start of the first bin.
    radar: linear power [n, points]. first_m: range of the first point. radar_cell_m, radar_taps:
    radar response (run.toml). array: antenna samples [n, bins, values] in the format of
    antennas.values(), each the mean of array_frames frames, with `antennas` as in Run.antennas.
    depth_m: z [n, rows, columns] with the top-left pixel first, in m, or in mm if they are
    integers; NaN, 0 or masked: no return. The width spans tangents of +-half_tangent, and depths
    above far_m count as no return. map_size: width and height of the maps; 0: the size of square
    images of 3 to 256 pixels, otherwise 64 with a warning. began: start of the run, UTC. label,
    labels: text or numbers. signal: limits of the verdicts, as in lab.toml."""
    given = {"spd": spd, "radar": radar, "array": array, "depth_m": depth_m}
    tables = {name: plain(name, values) for name, values in given.items() if values is not None}
    depth, in_mm = tables.pop("depth_m", (np.zeros(0), False))
    size = depth.shape[1:]
    if len(size) == 2 and not map_size and not (size[0] == size[1] and 3 <= size[0] <= 256):
        warnings.warn(f"depth_m: images of {size[0]} x {size[1]} pixels become maps of 64 x 64 "
                      "pixels; set map_size", stacklevel=2)
    sections: dict[str, dict[str, Any]] = {
        "": {"window_s": number("window_s", window_s), "label": text_of("label", label),
             "labels": [text_of("labels", one) for one in listed("labels", labels)],
             "notes": text_of("notes", notes)},
        "spd": {"first_bin_ps": number("first_bin_ps", first_bin_ps),
                "bin_width_ps": number("bin_width_ps", bin_width_ps),
                "irf_fwhm_ps": number("irf_fwhm_ps", irf_fwhm_ps),
                "zones": vectors("zones", zones)},
        "radar": {"first_m": number("first_m", first_m), "step_m": number("step_m", step_m),
                  "cell_m": number("radar_cell_m", radar_cell_m),
                  "taps": vectors("radar_taps", [radar_taps])[0],
                  "array_frames": number("array_frames", array_frames, int),
                  "antennas": vectors("antennas", antennas)},
        "depth": {"half_tangent": number("half_tangent", half_tangent),
                  "map_z_max_m": number("far_m", far_m),
                  "map_size": number("map_size", map_size, int), "unit": "mm" if in_mm else "m"},
        "signal": {toml(str(key)): number(f"signal[{key!r}]", value)
                   for key, value in entries("signal", signal)}}
    arrays = {name: table for name, (table, _) in tables.items()}
    import_arrays(path, sections, arrays | ({} if depth_m is None else {"depth": depth}),
                  *([] if began in (None, "") else ["--began", began]), program=program)
    return runs.open(new_path(path))


def import_arrays(out: Path, sections: dict[str, dict[str, Any]], arrays: dict[str, NDArray[Any]],
                  *options: str, program: str | None = None) -> None:
    """Writes run.toml and the arrays to a temporary folder next to `out`, and imports this folder
    as the run `out` (acquire/IMPORT.md). Raises RuntimeError with the program's error message if
    the import fails."""
    text = "".join((f"[{name}]\n" if name else "")
                   + "".join(f"{key} = {toml(value)}\n" for key, value in keys.items())
                   for name, keys in sections.items())
    parent = new_path(out).parent
    if not parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(parent))
    with tempfile.TemporaryDirectory(prefix="echofuse-", dir=parent) as folder:
        pathlib.Path(folder, "run.toml").write_text(text, encoding="utf-8")
        for name, table in arrays.items():
            np.save(pathlib.Path(folder, f"{name}.npy"), plain(name, table)[0])
        try:
            call(acquire_program(program), "import", folder, *out_option(out), *options)
        except ProgramError as error:
            message = str(error).replace(f"{folder}/depth.npy", "depth_m")
            message = message.replace('set depth.unit = "m"', "pass floating-point numbers"
                                      ).replace('depth.unit = "mm"', "integers in mm")
            message = re.sub(rf"{re.escape(folder)}/(\w+)\.npy", r"\1", message)
            raise RuntimeError(re.sub(rf"{re.escape(folder)}(/run\.toml)?(:\d+)*: ", "",
                                      message)) from None
