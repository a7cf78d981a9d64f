# SPDX-License-Identifier: MIT
"""Decodes depth images, resamples them to the map grid (acquire/measurement/depth_map.cpp), and
shifts range profiles."""
from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Growing", "cells", "inflated", "read_only", "shifted", "to_map"]


def cells(source: Any, target: Any) -> list[tuple[int, int]]:
    """For each target pixel, returns the interval [first, last) of the source pixels with centres
    inside the target pixel. If it contains none of the centres, the interval contains only the
    nearest source pixel. Outside the field of view of the camera, the interval is (0, 0). Both axes
    have the attributes count, start and step (run.Axis)."""
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
    """Returns a function that converts an image [size] (mm) to a map [rows, columns] (m, NaN: no
    return). A map pixel is the upper median of its valid source pixels, or NaN if fewer than half
    of the source pixels are valid. Depths above far_m are invalid."""
    limit, shape = round(far_m * 1000), (len(rows), len(columns))

    def in_m(mm: NDArray[np.uint16], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
        return np.where(valid, mm / np.float32(1000), np.float32(np.nan))

    if (columns, rows) == tuple([(i, i + 1) for i in range(n)] for n in reversed(size)):
        return lambda image: in_m(image, (image > 0) & (image <= limit))
    pixels = np.arange(size[0] * size[1]).reshape(size)
    inside = [pixels[top:bottom, left:right].ravel() for top, bottom in rows
              for left, right in columns]
    count = np.array([len(cell) for cell in inside])
    max_pixels = int(count.max(initial=1))
    # Indices of the source pixels of each target pixel, padded with the index of an invalid pixel.
    places = np.array([np.pad(cell, (0, max_pixels - len(cell)), constant_values=pixels.size)
                       for cell in inside], int).reshape(-1, max_pixels)
    first, last = np.arange(len(places)), max_pixels - 1

    def of_cells(image: NDArray[np.uint16]) -> NDArray[np.float32]:
        near = np.append(np.where(image <= limit, image, 0), np.uint16(0))
        cells = np.sort(near[places], axis=1)  # invalid pixels (0) are sorted first
        valid = np.count_nonzero(cells, axis=1)
        median = cells[first, np.minimum(last - valid + 1 + valid // 2, last)]
        return in_m(median, (valid > 0) & (2 * valid >= count)).reshape(shape)

    return of_cells


class Growing:
    """Array that grows by rows. Its memory doubles when it is full, so that the mean time to append
    a row does not depend on the number of rows."""

    def __init__(self, rows: NDArray[Any]) -> None:
        self.values, self._memory = rows, rows  # `values` is the part of the memory in use

    def append(self, rows: NDArray[Any]) -> None:
        known, end = len(self.values), len(self.values) + len(rows)
        if end > len(self._memory):
            self._memory = np.empty((max(end, 2 * known), *rows.shape[1:]), rows.dtype)
            self._memory[:known] = self.values
        self._memory[known:end] = rows
        self.values = self._memory[:end]


def read_only(table: NDArray[Any]) -> NDArray[Any]:
    """Returns a read-only view of the array."""
    view = table.view()
    view.flags.writeable = False
    return view


def shifted(table: NDArray[np.float32], steps: float) -> NDArray[np.float32]:
    """Shifts rows [n, points] or [n, points, values] towards the start by `steps` points (Lanczos
    interpolation, eight points, as in recon/data/shift.hpp). Rows with constant values (dead
    sensor) are not changed."""
    if steps == 0 or table.shape[1] == 0:
        return table
    if table.ndim == 3:
        flat = np.moveaxis(table, 2, 1).reshape(-1, table.shape[1])
        return np.moveaxis(shifted(flat, steps).reshape(len(table), -1, table.shape[1]), 1, 2)
    whole, x = int(np.floor(steps)), np.arange(8) - 3 - (steps - np.floor(steps))
    weights = np.sinc(x) * np.sinc(x / 4)
    padded = np.pad(table, ((0, 0), (abs(whole) + 8, abs(whole) + 8)))
    first = abs(whole) + 8 + whole - 3
    out = sum(w * padded[:, first + k:first + k + table.shape[1]]
              for k, w in enumerate(weights / weights.sum()))
    return np.where((table == table[:, :1]).all(1, keepdims=True), table, out).astype(np.float32)


def inflated(blob: bytes, size: tuple[int, int]) -> NDArray[np.uint16]:
    """Decodes a stored depth image [rows, columns], mm. Raises ValueError if it is damaged."""
    try:
        data = zlib.decompressobj().decompress(blob, 2 * size[0] * size[1] + 1)
        return np.frombuffer(data, "<u2").reshape(size)
    except (zlib.error, ValueError):
        raise ValueError(f"depth is not a deflated image of {size[1]} x {size[0]}") from None
