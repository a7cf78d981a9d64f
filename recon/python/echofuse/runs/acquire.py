# SPDX-License-Identifier: MIT
"""Recording from Python, and runs of one's own arrays: echofuse-acquire below it."""
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
    """Its path: as given, of $ECHOFUSE_ACQUIRE, or where the other programs are. Raises
    UsageError if the program is missing."""
    path = str(program or os.environ.get("ECHOFUSE_ACQUIRE") or path_of("echofuse-acquire"))
    if not shutil.which(path):
        raise not_started(path, "program not found")
    return path


def record(config: str | pathlib.Path | None = None, count: int = 1, *, label: str | None = None,
           out: str | pathlib.Path | None = None, settings: dict[str, Any] | None = None,
           program: str | None = None) -> runs.Run:
    """Records so many slots and returns the closed run. settings: {"run.window_s": 1.0}, over the
    configuration's; program: echofuse-acquire of that path ($ECHOFUSE_ACQUIRE). Raises RuntimeError
    with the program's own line if it ends otherwise; Ctrl-C ends the run with its slot."""
    words = [acquire_program(program), "run", "--json", "-q", "--count", str(count)]
    given = dict(settings or {}) | ({} if label is None else {"run.label": label})
    for option, value in (("--config", config), ("--out", out),
                          *(("--set", f"{k}={v}") for k, v in given.items())):
        words += [option, os.fspath(value)] if value is not None else []
    path = None
    # A session of its own: Ctrl-C at the terminal comes here alone, and goes on once.
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
            said = errors.read()
    if child.returncode or path is None:
        raise RuntimeError(said.strip()
                           or f"echofuse-acquire ended with exit code {child.returncode}")
    return runs.open(path)


def file_of(events: Iterator[dict[str, Any]]) -> str | None:
    """The run's file, when all events have come."""
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
    """Makes a run of arrays, by `echofuse-acquire import`, and opens it. spd: whole counts [n,
    bins] from first_bin_ps on (two-way time), or [n, zones, bins] with zones as Run.zones; radar:
    linear power [n, points] from first_m on; a row of NaN is a record without that sensor.
    radar_cell_m, radar_taps: the radar's response (run.toml); array [n, bins, values]: what
    antennas.values() gives, with antennas as Run.antennas. depth_m: z in metres [n, rows, columns],
    from the top left, NaN or 0: no return; its width spans tangents of +-half_tangent, and what
    lies beyond far_m is no return. began: UTC; signal: limits of the verdicts, as in lab.toml.
    Raises RuntimeError with the program's own line."""
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
    """Writes run.toml and the arrays into a folder beside `out`, and makes the run `out` of it
    (import, acquire/README.md). Raises RuntimeError with the program's own line."""
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
        said = done.stderr.strip().replace("echofuse-acquire: ", "")
        said = said.replace(f"{folder}/depth.npy", "depth_m")
        said = re.sub(rf"{re.escape(folder)}/(\w+)\.npy", r"\1", said)
        said = re.sub(rf"{re.escape(folder)}(/run\.toml)?: ", "", said)
    if done.returncode:
        raise RuntimeError((said.splitlines()
                            or [f"echofuse-acquire ended with exit code {done.returncode}"])[-1])
