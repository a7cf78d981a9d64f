# SPDX-License-Identifier: MIT
"""Depth images as they are stored, the truth on the maps' grid (acquire/measurement/depth_map.cpp),
and tables that are moved."""
from __future__ import annotations

import zlib
from collections.abc import Callable
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


def to_map(columns: list[tuple[int, int]], rows: list[tuple[int, int]], size: tuple[int, int],
           far_m: float) -> Callable[[NDArray[np.uint16]], NDArray[np.float32]]:
    """Returns a function from an image of this size, millimetres, to z in metres on the target
    pixels, NaN: no return. A pixel takes the upper median of the valid source pixels in it, if at
    least half of them are valid; nearer than far_m."""
    limit, shape = round(far_m * 1000), (len(rows), len(columns))

    def in_m(mm: NDArray[np.uint16], there: NDArray[np.bool_]) -> NDArray[np.float32]:
        return np.where(there, mm / np.float32(1000), np.float32(np.nan))

    if (columns, rows) == tuple([(i, i + 1) for i in range(n)] for n in reversed(size)):
        return lambda image: in_m(image, (image > 0) & (image <= limit))
    pixels = np.arange(size[0] * size[1]).reshape(size)
    inside = [pixels[top:bottom, left:right].ravel() for top, bottom in rows
              for left, right in columns]
    count = np.array([len(cell) for cell in inside])
    most = int(count.max(initial=1))
    # Source pixels of each target pixel, filled up with one that has no return.
    places = np.array([np.pad(cell, (0, most - len(cell)), constant_values=pixels.size)
                       for cell in inside], int).reshape(-1, most)
    first, last = np.arange(len(places)), most - 1

    def of_cells(image: NDArray[np.uint16]) -> NDArray[np.float32]:
        near = np.append(np.where(image <= limit, image, 0), np.uint16(0))
        cells = np.sort(near[places], axis=1)  # those without a return first
        valid = np.count_nonzero(cells, axis=1)
        median = cells[first, np.minimum(last - valid + 1 + valid // 2, last)]
        return in_m(median, (valid > 0) & (2 * valid >= count)).reshape(shape)

    return of_cells


def rows_of(count: int, rows: Any) -> NDArray[np.int64]:
    """Rows of `count` by a slice, a mask or a list. Raises IndexError."""
    wanted: slice | NDArray[Any] = rows if isinstance(rows, slice) else np.asarray(rows)
    if isinstance(wanted, np.ndarray) and not wanted.size:
        wanted = wanted.astype(int)  # the type of an empty list is float
    return np.asarray(np.arange(count)[wanted])


def read_only(table: NDArray[Any]) -> NDArray[Any]:
    """The array itself, made read-only; its copy() can be changed."""
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
