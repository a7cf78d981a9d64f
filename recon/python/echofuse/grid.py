# SPDX-License-Identifier: MIT
"""Depth images as they are stored, the truth on the maps' grid (acquire/measurement/depth_map.cpp),
and tables that are moved."""
from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray


def cells(source: Any, target: Any) -> list[tuple[int, int]]:
    """Source pixels [first, last) whose centres fall into each target pixel; the nearest one if
    none does, (0, 0) outside the camera's view. Both axes have count, start and step (run.Axis)."""
    out = []
    for i in range(target.count):
        a, b, centre = ((target.start + (i + off) * target.step - source.start) / source.step
                        for off in (-0.5, 0.5, 0.0))
        if centre < -0.5 or centre > source.count - 0.5:
            out.append((0, 0))
            continue
        first, last = (int(min(max(np.ceil(edge - 1e-9), -1), source.count))
                       for edge in (min(a, b), max(a, b)))
        if first >= last:
            first = int(np.floor(centre + 0.5))
            last = first + 1
        out.append((min(max(first, 0), source.count - 1), min(max(last, 1), source.count)))
    return out


def to_map(depth_mm: NDArray[np.uint16], columns: list[tuple[int, int]],
           rows: list[tuple[int, int]],
           far_m: float) -> NDArray[np.float32]:
    """z in metres on the target pixels, NaN: no return. A pixel takes the upper median of the valid
    source pixels in it, if at least half of them are valid; nearer than far_m."""
    out = np.full((len(rows), len(columns)), np.nan, np.float32)
    limit = round(far_m * 1000)
    for r, (top, bottom) in enumerate(rows):
        for c, (left, right) in enumerate(columns):
            cell = depth_mm[top:bottom, left:right]
            valid = cell[(cell > 0) & (cell <= limit)]
            if valid.size and 2 * valid.size >= cell.size:
                out[r, c] = np.partition(valid, valid.size // 2)[valid.size // 2] / np.float32(1000)
    return out


def read_only(table: NDArray[Any]) -> NDArray[Any]:
    """The array itself, which nobody changes by mistake now; its copy() can be changed."""
    table.flags.writeable = False
    return table


def shifted(table: NDArray[np.float32], steps: float) -> NDArray[np.float32]:
    """[n, points], so many steps towards the start (Lanczos' interpolation over eight points, as
    recon/data/shift.hpp). A row that is the same throughout, of a dead sensor, stays."""
    if steps == 0 or table.shape[1] == 0:
        return table
    whole, x = int(np.floor(steps)), np.arange(8) - 3 - (steps - np.floor(steps))
    weights = np.sinc(x) * np.sinc(x / 4)
    padded = np.pad(table, ((0, 0), (abs(whole) + 8, abs(whole) + 8)))
    first = abs(whole) + 8 + whole - 3
    out = sum(w * padded[:, first + k:first + k + table.shape[1]]
              for k, w in enumerate(weights / weights.sum()))
    return np.where((table == table[:, :1]).all(1, keepdims=True), table, out).astype(np.float32)


def inflated(blob: bytes, size: tuple[int, int]) -> NDArray[np.uint16]:
    """A depth image as run files have it [rows, columns], millimetres. Raises ValueError."""
    try:
        data = zlib.decompressobj().decompress(blob, 2 * size[0] * size[1] + 1)
        return np.frombuffer(data, "<u2").reshape(size)
    except (zlib.error, ValueError):
        raise ValueError(f"a depth image is not a deflated one of {size[1]} x {size[0]}") from None
