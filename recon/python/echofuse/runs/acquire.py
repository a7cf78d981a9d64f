# SPDX-License-Identifier: MIT
"""Records runs and imports arrays with the program echofuse-acquire."""
from __future__ import annotations

import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import run as runs
from .programs import not_started, path_of


def acquire_program(program: str | None) -> str:
    """Returns the path of echofuse-acquire: `program`, $ECHOFUSE_ACQUIRE, or the file in the folder
    of the other echofuse programs. Raises UsageError if the program is missing."""
    path = str(program or os.environ.get("ECHOFUSE_ACQUIRE") or path_of("echofuse-acquire"))
    if not shutil.which(path):
        raise not_started(path, "program not found")
    return path


def record(config: str | pathlib.Path | None = None, count: int = 1, *, label: str | None = None,
           out: str | pathlib.Path | None = None, settings: dict[str, Any] | None = None,
           program: str | None = None) -> runs.Run:
    """Records `count` slots and returns the closed run. `settings` override the configuration, e.g.
    {"run.window_s": 1.0}. `program` is the path of echofuse-acquire (default: $ECHOFUSE_ACQUIRE).
    Raises RuntimeError with the program's error message if the program fails. Ctrl-C ends the run
    after the current slot."""
    words = [acquire_program(program), "run", "--json", "-q", "--count", str(count)]
    settings = dict(settings or {}) | ({} if label is None else {"run.label": label})
    for option, value in (("--config", config), ("--out", out),
                          *(("--set", f"{k}={v}") for k, v in settings.items())):
        words += [option, os.fspath(value)] if value is not None else []
    path = None
    # The child has its own session, so that Ctrl-C reaches it only through send_signal() below.
    with tempfile.TemporaryFile("w+") as errors, subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=errors, text=True,
            start_new_session=True) as child:
        try:
            path = file_of(map(json.loads, child.stdout or ()))
        except KeyboardInterrupt:
            child.send_signal(signal.SIGINT)
            child.communicate()
            raise
        finally:
            child.wait()
            errors.seek(0)
            message = errors.read()
    if child.returncode or path is None:
        raise RuntimeError(message.strip()
                           or f"echofuse-acquire ended with exit code {child.returncode}")
    return runs.open(path)


def file_of(events: Iterator[dict[str, Any]]) -> str | None:
    """Reads all JSON events of echofuse-acquire, and returns the path of the run file."""
    found = None
    for event in events:
        found = event["file"] if event["event"] == "run" else found
    return found


def write_run(path: str | pathlib.Path, *, spd: ArrayLike | None = None, first_bin_ps: float = 0,
              bin_width_ps: float = 100, zones: Iterable[Iterable[float]] = (),
              irf_fwhm_ps: float = 0, radar: ArrayLike | None = None, first_m: float = 0,
              step_m: float = 0.25,
              radar_cell_m: float = 0, radar_taps: Iterable[float] = (),
              array: ArrayLike | None = None,
              antennas: Iterable[Iterable[float]] = (), depth_m: ArrayLike | None = None,
              half_tangent: float = 0.55,
              far_m: float = 6, window_s: float = 3, began: str = "", label: str = "",
              labels: Iterable[str] = (),
              notes: str = "", signal: dict[str, float] | None = None,
              program: str | None = None) -> runs.Run:
    """Writes arrays as a run with `echofuse-acquire import`, and opens the run. NaN in all values
    of a row means that the sensor is missing in this record. Raises RuntimeError with the program's
    error message if the import fails.

    spd: integer counts [n, bins], or [n, zones, bins] with `zones` as in Run.zones. first_bin_ps:
    two-way time at the start of the first bin. radar: linear power [n, points]. first_m: range of
    the first point. radar_cell_m, radar_taps: radar response (run.toml). array: antenna samples [n,
    bins, values] in the format of antennas.values(), with `antennas` as in Run.antennas. depth_m: z
    [n, rows, columns] with the top-left pixel first, NaN or 0: no return; the width spans tangents
    of +-half_tangent, and depths above far_m count as no return. began: start of the run, UTC.
    signal: limits of the verdicts, as in lab.toml."""
    radar_keys = {"first_m": float(first_m), "step_m": float(step_m), "cell_m": float(radar_cell_m),
                  "taps": " ".join(map(repr, map(float, radar_taps))),
                  "antennas": [" ".join(map(repr, map(float, place))) for place in antennas]}
    sections: dict[str, dict[str, Any]] = {
        "": {"window_s": float(window_s), "label": label, "labels": list(labels), "notes": notes},
        "spd": {"first_bin_ps": float(first_bin_ps), "bin_width_ps": float(bin_width_ps),
                "irf_fwhm_ps": float(irf_fwhm_ps),
                "zones": [" ".join(map(repr, map(float, zone))) for zone in zones]},
        "radar": radar_keys, "depth": {"half_tangent": float(half_tangent),
                                       "map_z_max_m": float(far_m)},
        "signal": {key: float(value) for key, value in (signal or {}).items()}}
    import_arrays(path, sections, {"spd": spd, "radar": radar, "array": array, "depth": depth_m},
                  *(["--began", began] if began else []), program=program)
    return runs.open(path)


def import_arrays(out: str | pathlib.Path, sections: dict[str, dict[str, Any]],
                  arrays: dict[str, ArrayLike | None],
                  *options: str, program: str | None = None) -> None:
    """Writes run.toml and the arrays to a temporary folder next to `out`, and imports this folder
    as the run `out` (acquire/README.md). Raises RuntimeError with the program's error message if
    the import fails."""
    text = "".join((f"[{name}]\n" if name else "")
                   + "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
                   for name, keys in sections.items())
    with tempfile.TemporaryDirectory(prefix="echofuse-",
                                     dir=pathlib.Path(out).absolute().parent) as folder:
        pathlib.Path(folder, "run.toml").write_text(text)
        for name, values in arrays.items():
            if values is not None:
                array = np.asarray(values)
                kind = np.dtype("<f4") if array.dtype.kind == "f" else array.dtype.newbyteorder("<")
                np.save(pathlib.Path(folder, f"{name}.npy"), np.ascontiguousarray(array, kind))
        words = [acquire_program(program), "import", folder, "--out", os.fspath(out)]
        done = subprocess.run([*words, *options], capture_output=True, text=True, check=False)
        message = done.stderr.strip().replace("echofuse-acquire: ", "")
        message = message.replace(f"{folder}/depth.npy", "depth_m")
        message = re.sub(rf"{re.escape(folder)}/(\w+)\.npy", r"\1", message)
        message = re.sub(rf"{re.escape(folder)}(/run\.toml)?: ", "", message)
    if done.returncode:
        raise RuntimeError((message.splitlines()
                            or [f"echofuse-acquire ended with exit code {done.returncode}"])[-1])
