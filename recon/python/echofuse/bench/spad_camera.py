# SPDX-License-Identifier: MIT
"""Scores the first return of pooled zones on real photons of a SPAD camera of 32 x 32 pixels.

The data set is public (Callenberg et al., Sci. Rep. 2021). NAME.mat contains a histogram for each
pixel, in which the background is already subtracted. Windows of 24 x 24 pixels are pooled into 1
to 64 zones. The ground-truth depth of a pixel is the peak of its own histogram, so static scenes
are scored with depths from the same sensor. No model is trained. Needs python3-scipy.

    python3 -m echofuse.bench.spad_camera FOLDER

Prints a CSV line for each scene, with IoU / depth error for each number of zones."""
from __future__ import annotations

import csv
import pathlib
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..models.photon_baselines import OpenFirstReturn, interpolation, refined, smooth

__all__ = ["SCENES", "ZONES", "pooled", "read", "score", "truth_of"]

Array = NDArray[np.floating[Any]]
ZONES = (1, 2, 3, 4, 6, 8)  # zones per side
SIDE, STARTS = 24, (0, 4, 8)  # size of a window, and its first rows and columns, pixels
FIRST, BINS = 72, 60  # before the first bin, the instrument has a reflection
BIN_M = 0.06 / 7.575  # measured on the steps, which are 6 cm high
# file of each scene; whether its bins are in reverse order
SCENES = {"letters": ("letters_board_0-6-12", False), "basketball": ("basketball", True)}
STEPS = ("steps_0-6-12", False)  # shows which pixels are dead, hot or late
RANGE_M = BIN_M * np.arange(BINS)


def read(folder: pathlib.Path, name: str, is_reversed: bool) -> Array:
    """Reads the histograms [32, 32, BINS] of a scene. Raises ValueError if the file is invalid."""
    from scipy.io import loadmat  # optional

    path = folder / f"{name}.mat"
    with open(path, "rb") as file:
        counts = np.asarray(loadmat(file).get("SPAD_5mm", 0.0), float)
    if counts.ndim != 3 or counts.shape[:2] != (32, 32) or counts.shape[2] < FIRST + BINS:
        raise ValueError(f"{path}: SPAD_5mm has shape {counts.shape} (expected [32, 32, bins] with "
                         f"at least {FIRST + BINS} bins)")
    return counts[:, :, ::-1 if is_reversed else 1][..., FIRST:FIRST + BINS]


def highest(counts: Array) -> tuple[Array, Array]:
    """Returns the position, in bins, and the height of the highest peak of histograms [..., bins].
    """
    h = smooth(counts)
    at = h[..., 1:-1].argmax(-1) + 1
    return refined(h, at), np.take_along_axis(h, at[..., None], -1)[..., 0]


def damaged_pixels(steps: Array) -> NDArray[np.bool_]:
    """Returns which pixels are dead, hot or late, from the scene with steps."""
    from scipy.ndimage import median_filter

    place, height = highest(steps)
    usual = median_filter(height, 5)
    return np.asarray((height < 0.6 * usual) | (height > 1.8 * usual)
                      | (np.abs(place - median_filter(place, 5)) > 2))


def repaired(values: Array, damaged: NDArray[np.bool_]) -> Array:
    """Replaces damaged pixels with the median of the intact pixels around them."""
    out = values.copy()
    for row, column in np.argwhere(damaged):
        near = np.s_[max(0, row - 1):row + 2, max(0, column - 1):column + 2]
        if (~damaged[near]).any():
            out[row, column] = np.median(values[near][~damaged[near]])
    return out


def truth_of(counts: Array, damaged: NDArray[np.bool_]) -> Array:
    """Returns the range of the object in each pixel [32, 32], m; NaN for the background. The
    threshold of the peak height separates two classes with the least variance (Otsu)."""
    place, height = (repaired(part, damaged) for part in highest(counts))
    light = np.log(np.maximum(height, 5))
    v = np.sort(light.ravel())
    n, below = np.arange(1, len(v)), np.cumsum(v)[:-1]
    apart = below / n - (v.sum() - below) / (len(v) - n)
    k = int((n * (len(v) - n) * apart**2).argmax())
    return np.where(light > (v[k] + v[k + 1]) / 2, BIN_M * place, np.nan)


def pooled(window: Array, side: int) -> Array:
    """Sums the histograms of a window [SIDE, SIDE, bins] over side x side zones [zones, bins]."""
    n = SIDE // side
    return window.reshape(side, n, side, n, -1).sum((1, 3)).reshape(side * side, -1)


def score(counts: Array, truth: Array, side: int) -> tuple[float, float]:
    """Returns the IoU and the depth error, m, of the first returns, as means over the windows of a
    scene."""
    at = (2 * np.arange(SIDE) + 1) / SIDE - 1
    centre = (2 * np.arange(side) + 1) / side - 1
    weights = interpolation(np.array([(x, -y) for y in centre for x in centre]),
                            *np.meshgrid(at, -at))
    scores = []
    for row in STARTS:
        for column in STARTS:
            window = np.s_[row:row + SIDE, column:column + SIDE]
            objects = OpenFirstReturn.objects(pooled(counts[window], side), RANGE_M)
            found = OpenFirstReturn.map_of(*objects, weights)
            both = np.isfinite(found) & np.isfinite(truth[window])
            either = np.isfinite(found) | np.isfinite(truth[window])
            scores.append((both.sum() / either.sum(),
                           np.abs(found - truth[window])[both].mean() if both.any() else np.nan))
    iou, error = np.nanmean(scores, 0)
    return float(iou), float(error)


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit("usage: python3 -m echofuse.bench.spad_camera FOLDER")
    folder, out = pathlib.Path(sys.argv[1]), csv.writer(sys.stdout, lineterminator="\n")
    try:
        damaged = damaged_pixels(read(folder, *STEPS))
        out.writerow(["scene", *(f"{side**2} zone{'s' * (side > 1)}" for side in ZONES)])
        for scene, (name, is_reversed) in SCENES.items():
            counts = read(folder, name, is_reversed)
            truth = truth_of(counts, damaged)
            scores = [score(counts, truth, side) for side in ZONES]
            out.writerow([scene, *(f"{iou:.3f} / {100 * error:.2f} cm" for iou, error in scores)])
    except (OSError, ValueError, ImportError) as error:
        sys.exit(f"spad_camera: {error}")


if __name__ == "__main__":
    main()
