# SPDX-License-Identifier: MIT
"""Recognises ten letters in depth maps. The ground-truth map determines the size and the position
of the letter plate. Pixels in front of the plate, or up to 20 cm behind it, are resampled to 2 cm
cells and correlated with templates of the letters. The score of a letter is its highest normalised
correlation over offsets of up to 8 cm from the plate position."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["SIZES", "read", "text"]

LETTERS = "ACEHLNOTUX"
# width, height and stroke width of the letter plates, m (acquire/measurement/letter.hpp)
SIZES = ((0.30, 0.40, 0.07), (0.20, 0.30, 0.05))
CELL_M, MAX_SHIFT_M, NEAR_M = 0.02, 0.08, 0.2
BLUR_DEPTH_M = 3.0  # depth at which the width of a map pixel sets the blur of the templates, m
Floats = NDArray[np.float64]


def strokes(letter: str, width: float, height: float,
            stroke: float) -> list[tuple[float, float, float, float]]:
    """Returns the centre line (u0, v0, u1, v1) of each stroke, m. The u axis points to the right,
    and the v axis upwards."""
    right, top = width / 2, height / 2
    a, b = right - stroke / 2, top - stroke / 2
    foot = -top / 3
    u = a * (top - foot) / (2 * top)
    post_left, post_right = (-a, -top, -a, top), (a, -top, a, top)
    roof, base, bar = (-right, b, right, b), (-right, -b, right, -b), (-right, 0, right, 0)
    return {"A": [(-a, -top, 0, top), (0, top, a, -top), (-u, foot, u, foot)],
            "C": [post_left, roof, base],
            "E": [post_left, roof, bar, base], "H": [post_left, post_right, bar],
            "L": [post_left, base], "N": [post_left, post_right, (-a, top, a, -top)],
            "O": [post_left, post_right, roof, base],
            "T": [roof, (0, -top, 0, top)], "U": [post_left, post_right, base],
            "X": [(-a, -top, a, top), (-a, top, a, -top)]}[letter]


def template(letter: str, size: tuple[float, float, float], step: float) -> Floats:
    """Returns a blurred image [rows, columns] of the letter with a margin of one cell on each
    side. Each cell is the mean of 4 x 4 samples. `step` is the angular width of a map pixel,
    expressed as a tangent."""
    fine, (width, height, stroke) = 4, size
    shape = [round(length / CELL_M) + 2 for length in (height, width)]
    v, u = ((np.arange(fine * n) + 0.5 - fine * n / 2) * CELL_M / fine for n in shape)
    u, v = np.meshgrid(u, -v)
    drawn = np.zeros(u.shape)
    for u0, v0, u1, v1 in strokes(letter, *size):
        along, across = ((u - u0) * (u1 - u0) + (v - v0) * (v1 - v0),
                         (u - u0) * (v1 - v0) - (v - v0) * (u1 - u0))
        length = np.hypot(u1 - u0, v1 - v0)
        drawn[(along >= 0) & (along <= length ** 2) & (abs(across) <= stroke / 2 * length)] = 1
    wide = 1 + 2 * int(fine * step * BLUR_DEPTH_M / CELL_M / 2)
    for axis in (0, 1):
        drawn = np.apply_along_axis(np.convolve, axis, drawn, np.ones(wide) / wide, "same")
    return np.asarray(drawn.reshape(shape[0], fine, shape[1], fine).mean((1, 3)))


def near_layer(depth_m: NDArray[np.float32], half_tangent: float, plate: tuple[float, float, float],
               shape: tuple[int, int]) -> Floats:
    """Resamples a map to cells around a plate. A cell is 1 where the map is in front of the plate
    or at most NEAR_M behind it, and 0 elsewhere; values between pixels are interpolated. `plate` is
    (x, y, depth): the position of the plate centre as two tangents, and its depth, m."""
    x, y, at_m = plate
    side = len(depth_m)
    near = np.pad(np.nan_to_num(depth_m, nan=np.inf) < at_m + NEAR_M, 1).astype(float)
    per_m = side / (2 * half_tangent) / at_m  # pixels per metre at the plate
    rows, columns = ((np.arange(n) - (n - 1) / 2) * CELL_M * per_m + middle
                     for n, middle in zip(shape, (-y * at_m * per_m + (side - 1) / 2,
                                                  x * at_m * per_m + (side - 1) / 2)))
    rows, columns = (np.clip(at + 1, 0, side + 1) for at in (rows, columns))
    top, left = (np.minimum(at.astype(int), side) for at in (rows, columns))
    down, right = (rows - top)[:, None], columns - left
    upper, lower = (near[top + k][:, left] * (1 - right) + near[top + k][:, left + 1] * right
                    for k in (0, 1))
    return np.asarray(upper * (1 - down) + lower * down)


def match(patch: Floats, pattern: Floats) -> tuple[float, float, float]:
    """Returns the highest normalised correlation of the pattern with the patch, and the offset
    (right, down) of the pattern from the patch centre, in cells."""
    rows, columns = (n - k + 1 for n, k in zip(patch.shape, pattern.shape))

    def correlated(values: Floats, kernel: Floats) -> Floats:
        product = np.fft.rfft2(values) * np.fft.rfft2(kernel, values.shape).conj()
        return np.asarray(np.fft.irfft2(product, values.shape)[:rows, :columns])

    pattern, ones = pattern - pattern.mean(), np.ones(pattern.shape)
    spread = correlated(patch ** 2, ones) - correlated(patch, ones) ** 2 / pattern.size
    norm = np.sqrt(np.maximum(spread, 0) * (pattern ** 2).sum())
    found = np.where(norm > 1e-5, correlated(patch, pattern) / np.maximum(norm, 1e-5), 0)
    row, column = np.unravel_index(found.argmax(), found.shape)
    return float(found.max()), float(column - (found.shape[1] - 1)
                                     / 2), float(row - (found.shape[0] - 1) / 2)


def read(maps: NDArray[np.float32], truth: NDArray[np.float32], labels: Sequence[str],
         half_tangent: float) -> tuple[Floats, NDArray[np.int64]]:
    """Recognises the letters in maps [n, N, N] (m, NaN: no return). Returns the scores [n] and the
    indices [n] of the plate sizes in SIZES. The score is 1 if the labelled letter ("letter:A") fits
    best, 1 / k if it ties for best among k letters, and 0 otherwise. The chance level is 0.1. For
    records with other labels, the score is NaN and the index is -1. The background must be more
    than 20 cm behind the plate."""
    step, out = 2 * half_tangent / truth.shape[1], np.full(len(maps), np.nan)
    sizes = np.full(len(maps), -1)
    known = [{letter: template(letter, size, step) for letter in LETTERS} for size in SIZES]
    for row, label in enumerate(labels):
        letter = label.removeprefix("letter:")
        is_letter = letter != label and len(letter) == 1 and letter in LETTERS
        if not (is_letter and (truth[row] > 0).any()):
            continue
        at_m = float(np.nanmin(truth[row])) + 0.1
        side = round(2 * half_tangent * at_m / CELL_M)
        layer = near_layer(truth[row], half_tangent, (0, 0, at_m), (side, side))
        (_, x, y), size = max(((match(layer, drawn[letter]), k) for k, drawn in enumerate(known)),
                              key=lambda found: found[0][0])
        drawn, sizes[row] = known[size], size
        shape = [n + 2 * round(MAX_SHIFT_M / CELL_M) for n in drawn[letter].shape]
        patch = near_layer(maps[row], half_tangent, (x * CELL_M / at_m, -y * CELL_M / at_m, at_m),
                           (shape[0], shape[1]))
        scores = [match(patch, drawn[name])[0] for name in LETTERS]
        own = scores[LETTERS.index(letter)]
        out[row] = 0 if max(scores) > own else 1 / scores.count(own)
    return out, sizes


def text(share: Floats, sizes: NDArray[np.int64]) -> str:
    """Returns a summary with one line for all letters, and one line for each letter size."""
    lines = []
    for name, rows in [("letters", sizes >= 0),
                       *((f"letters of {100 * high:.0f} x {100 * wide:.0f} cm", sizes == k)
                         for k, (wide, high, _) in enumerate(SIZES))]:
        part = share[rows & np.isfinite(share)]
        error = part.std(ddof=1) / np.sqrt(len(part)) if len(part) > 1 else float("nan")
        if len(part):
            lines.append(f"{len(part)} {name}: fraction recognised {part.mean():.3f} +- "
                         f"{error:.3f}")
    return "\n".join(lines) + "; 0.1 is expected by chance"
