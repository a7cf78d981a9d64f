# SPDX-License-Identifier: MIT
"""Writes one record as CSV."""
from __future__ import annotations

import pathlib

import numpy as np

from ..runs import antennas
from ..runs.batches import load
from ..runs.run import Run
from ..runs.run_files import printable

__all__ = ["write"]


def write(run: Run, index: int, path: pathlib.Path) -> int:
    """Writes one record as lines "sensor,x,y,value", after header lines (starting with "#") that
    contain the units. Always returns 0 as the number of unreadable records. Raises ValueError if
    the record is missing or damaged."""
    if index not in run.index:
        raise ValueError(f"{run.path}: record {index} is missing (the run has {len(run)} records)")
    part = run[np.flatnonzero(run.index == index)[:1]]
    load(part)

    def escaped(text: str) -> str:
        """Escapes separators and quotes, so that the header line is one CSV field."""
        return "".join(f"\\x{ord(c):02x}" if c in ',;"' else c for c in printable(text))

    lines = [f"# record {index} of {escaped(str(part.path))}, label {escaped(part.labels[0])}",
             "# spd: x = two-way time in ps, value = counts" + ", y = zone" * bool(part.zones),
             "# radar: x = range in m, value = quantity of the radar axis",
             "# depth: x, y = tangents, value = depth in mm (0 = no return)"]
    sines = (2 * np.arange(32) + 1) / 32 - 1
    beams = (antennas.beams(part, sines) if "array" in part.axes and part.antennas
             else np.full((1, 1, 1), np.nan))
    if has_array := not np.isnan(beams).any():
        lines.append(
            "# array: x = range in m, y = sine of the azimuth (positive = right), value = power "
            f"from this direction, mean over {antennas.frames(part)[0]} frames")
    lines.append("sensor,x,y,value")
    zones: list[int | str] = [*range(len(part.zones))] or [""]
    for name, values in ("spd", part.spd), ("radar", part.radar):
        if part.valid[name][0]:
            of_zones = values[0].reshape(-1, values.shape[-1]).tolist()
            lines += [f"{name},{x:.9g},{zone},{value:.9g}"
                      for zone, row in zip(zones if name == "spd" else [""], of_zones)
                      for x, value in zip(part.axes[name].values, row)]
    if has_array:
        lines += [f"array,{x:.9g},{y:.9g},{power:.9g}"
                  for x, powers in zip(part.axes["array"].values, beams[0])
                  for y, power in zip(sines, powers)]
    if part.valid["depth"][0]:
        lines += [f"depth,{x:.9g},{y:.9g},{mm}"
                  for y, row in zip(part.axes["depth_y"].values, part.depth_mm(0))
                  for x, mm in zip(part.axes["depth_x"].values, row)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="surrogateescape")
    return 0
