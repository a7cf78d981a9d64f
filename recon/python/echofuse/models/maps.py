# SPDX-License-Identifier: MIT
"""Reads and writes maps in the format of `echofuse-recon evaluate --maps`: FOLDER/maps.npy and
FOLDER/records.csv."""
from __future__ import annotations

import csv
import pathlib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..metrics import pixels
from ..runs.arguments import plain
from ..runs.run_files import printable
from ..runs.staged import replaced

if TYPE_CHECKING:
    from ..runs.run import Run

__all__ = ["load_maps", "origin_of", "save_maps", "span_of"]


def origin_of(run: Run) -> str:
    """Returns the text of run.txt, which identifies the run to which the maps belong
    (recon/maps/written_maps.hpp)."""
    return f"{run.info['uuid']}\n{printable(str(run.path))}\n"


def require_indices(maps: NDArray[Any], index: NDArray[Any], run: Run | None) -> None:
    """Raises ValueError if a shape is wrong, or if the indices are not distinct records of the
    run."""
    if maps.ndim != 3 or maps.shape[1] != maps.shape[2]:
        raise ValueError(f"depth_m: shape {list(maps.shape)} (expected [n, N, N])")
    if (index.shape != maps.shape[:1] or (index.size and index.dtype.kind not in "iu")
            or np.ma.is_masked(index) or (index.astype(np.int64) < 0).any()):
        raise ValueError(f"index: {index.dtype} {list(index.shape)} (expected {len(maps)} record "
                         "indices)")
    known, count = np.unique(index, return_counts=True)
    if (count > 1).any():
        raise ValueError(f"index: record {known[count > 1][0]} has {count[count > 1][0]} maps "
                         "(expected 1)")
    if run is not None and (missing := np.setdiff1d(index, run.index)).size:
        raise ValueError(f"index: {run.path} has no record {missing[0]}; pass values of run.index")


def save_maps(folder: str | pathlib.Path, depth_m: ArrayLike, index: ArrayLike,
              origin: str = "", *, run: Run | None = None) -> None:
    """Writes maps [n, N, N] (m, NaN or masked: no return) of the records with the given indices
    [n]. `run` or `origin` (text of run.txt) identifies the run. Raises FileExistsError if the
    folder contains maps of another run, and ValueError if a shape, an index or a depth is wrong."""
    folder, indices = pathlib.Path(folder), np.ma.asarray(index)
    maps = plain("maps", depth_m)[0]
    require_indices(maps, indices, run)
    pixels(maps)  # checks the depths
    folder.mkdir(parents=True, exist_ok=True)
    if run is not None:
        origin = origin_of(run)
    named = folder / "run.txt"
    if origin and named.exists() and named.read_text("utf-8-sig", "replace").split(
            "\n")[0] != origin.split("\n")[0]:
        raise FileExistsError(f"{folder}: contains maps of another run; choose another folder")
    named.unlink(missing_ok=True)
    if origin:
        with replaced(folder / "run.txt") as new:
            new.write_text(origin)
    with replaced(folder / "maps.npy") as new, open(new, "wb") as binary:
        np.save(binary, np.ascontiguousarray(maps, "<f4"))
    lines = ["record,status", *(f"{int(i)},ok" for i in indices.tolist())]
    with replaced(folder / "records.csv") as new:
        new.write_text("\n".join(lines) + "\n")


def load_maps(folder: str | pathlib.Path) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Reads maps [n, N, N] and their record indices [n], as written by save_maps() or
    `reconstruct --format npy`. Raises ValueError for files that `evaluate --maps` refuses
    (recon/maps/written_maps.cpp)."""
    folder, words = pathlib.Path(folder), []
    try:
        with open(folder / "records.csv", newline="", encoding="utf-8-sig",
                  errors="replace") as file:
            for row in csv.DictReader(file):
                word, status = row["record"] or "", row["status"] or ""
                if not (word.isascii() and word.isdigit() and status):
                    raise ValueError(f'records.csv: expected a record index and a status, not '
                                     f'"{printable(word)}" and "{printable(status)}"')
                if status.startswith(("ok", "radar lost", "antennas lost")):
                    words.append(word)
        index = np.array(words, "u8")
        with open(folder / "maps.npy", "rb") as binary:
            stored = np.load(binary)
            if binary.read(1):
                raise ValueError("maps.npy: contains bytes after the array")
        maps = plain("maps", stored)[0]
        require_indices(maps, index, None)
        pixels(stored)  # checks the depths
        if stored.dtype.str[0] == ">" or stored.dtype == "f2" or not stored.flags.c_contiguous:
            raise ValueError("maps.npy: expected little-endian numbers in C order")
    except KeyError as error:
        raise ValueError(f"{folder}: records.csv has no column {error}") from None
    except (ValueError, AttributeError, EOFError, OverflowError) as error:
        raise ValueError(f"{folder}: {error}") from None
    return maps, index.astype(np.int64)


def span_of(depth_m: ArrayLike) -> tuple[float, float]:
    """Returns the limits of the depth range that contains 96 % of the returns, m, rounded outwards
    to multiples of 0.5 m. Returns 2.5 and 5 if there are fewer than 50 returns."""
    returns = np.asarray(depth_m, float)
    returns = np.sort(returns[returns > 0])
    if len(returns) < 50:
        return 2.5, 5.0
    near = np.floor(2 * returns[int(0.02 * (len(returns) - 1))]) / 2
    far = np.ceil(2 * returns[int(0.98 * (len(returns) - 1))]) / 2
    return float(near), float(max(far, near + 1))
