# SPDX-License-Identifier: MIT
"""Scores of depth maps as functions of arrays, for a training loop. The judge is
`echofuse-recon evaluate` (recon/metrics); a test compares both.

All functions take maps [n, N, N] and true maps [n, N, N] of the same records, z in metres (NaN or
0: no return), from the top left, and the scene of the training maps. They return [n] float64; NaN
where a map does not define the score.

>>> scene = metrics.Scene.of_maps(run.maps(split.train))
>>> np.nanmean(metrics.iou(maps, run.maps(split.test), scene))
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from .runs.axis import tangents

Scores = NDArray[np.float64]
STEP_M = 0.1  # smallest distance of a foreground from the background
BEHIND = 0.25  # largest share of the foreground behind the background, weighted by metres
NEAREST, NEARER = 0.125, 0.1  # Scene.holds_returns
SIDE_M = 0.3  # smallest |x| of a body whose mirror image is another place
WINDOW, SIGMA = 11, 1.5  # pixels, of SSIM


def pixels(maps: ArrayLike) -> NDArray[np.float32]:
    """Maps [n, N, N] with 0 in place of NaN. Raises ValueError."""
    table = np.nan_to_num(np.asarray(maps, np.float32))
    if table.ndim != 3 or table.shape[1] != table.shape[2]:
        raise ValueError(f"maps: an array {list(table.shape)}; expected [n, N, N]")
    return table


def ratio(above: NDArray[Any], below: NDArray[Any], least: float = 0) -> Scores:
    """above / below, NaN unless below > least."""
    enough = below > least
    return np.where(enough, above / np.where(enough, below, 1), np.nan)


@dataclass(frozen=True)
class Scene:
    """Background and foreground of the training maps (recon/metrics/scene_model.hpp)."""

    background_m: NDArray[np.float32]  #: z [N, N], 0: no return
    foreground_m: float  #: mean z of the foreground; 0: no body stands out
    half_tangent: float = 0.55  #: x / z at the right edge of the maps
    far_m: float = 6.0  #: largest z of a map

    @classmethod
    def of_maps(cls, maps: ArrayLike, half_tangent: float = 0.55, far_m: float = 6.0) -> Scene:
        """Scene of training maps [n, N, N], n >= 1 (learn_scene in scene_model.cpp)."""
        table = pixels(maps)
        some = table[::max(1, len(table) // 1000)]
        background = np.partition(some, len(some) // 2, axis=0)[len(some) // 2]
        background[5 * np.count_nonzero(table <= 0, axis=0) >= len(table)] = 0
        scene = cls(background, 1.0, half_tangent, far_m)
        mask = scene.true_mask(table)
        before = np.where(mask, background - table, 0)
        behind = -np.minimum(before, 0)[:, background > 0].sum(dtype=float)
        if not mask.any() or behind >= BEHIND * abs(before).sum(dtype=float):
            return cls(background, 0.0, half_tangent, far_m)
        mean = float(np.float32(table[mask].mean(dtype=float)))
        return cls(background, mean, half_tangent, far_m)

    def true_mask(self, truth: ArrayLike) -> NDArray[np.bool_]:
        """Foreground [n, N, N] of true maps: a return, and no background or 0.1 m off it."""
        z, b = pixels(truth), self.background_m
        return (self.foreground_m > 0) & (z > 0) & ((b <= 0) | (abs(z - b) > np.float32(STEP_M)))

    def holds_returns(self, maps: ArrayLike) -> NDArray[np.bool_]:
        """Whether maps [n] hold depths of returns, not expected depths of a regression, which has
        many values near 0: at most a tenth of those without a background are below m / 8."""
        z = pixels(maps)
        open_ = (self.background_m <= 0) & (z > 0)
        nearer = open_ & (z < np.float32(NEAREST) * np.float32(self.foreground_m))
        return np.asarray(nearer.sum((1, 2)) <= NEARER * open_.sum((1, 2)))

    def share(self, maps: ArrayLike) -> NDArray[np.float32]:
        """Place of each pixel [n, N, N] between background, 0, and mean foreground, 1; above 0.5 it
        is foreground. Where there is no background, a return is 1."""
        z, b = self.clipped(maps), self.background_m
        if self.foreground_m <= 0:
            return np.zeros_like(z)
        way = np.float32(self.foreground_m) - b
        apart = abs(way) > np.float32(STEP_M)
        share = np.where(apart, z - b, 0) / np.where(apart, way, 1)
        returns = self.holds_returns(z)[:, None, None] & (b <= 0)
        return np.where(returns, z > 0, share).astype(np.float32)

    def clipped(self, maps: ArrayLike) -> NDArray[np.float32]:
        """Maps [n, N, N] within 0 to far_m."""
        return pixels(maps).clip(0, np.float32(self.far_m))


def iou(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Intersection over union of the foregrounds, 0 to 1."""
    true, found = scene.true_mask(truth), scene.share(maps) > 0.5
    return ratio((true & found).sum((1, 2)), (true | found).sum((1, 2)))


def depth_mae(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Mean absolute error of z over the intersection of the foregrounds, metres."""
    both = scene.true_mask(truth) & (scene.share(maps) > 0.5)
    error = abs(scene.clipped(maps).astype(float) - pixels(truth))
    return ratio((error * both).sum((1, 2)), both.sum((1, 2)))


def centroids(mask: NDArray[np.bool_], scene: Scene) -> Scores:
    """x / z [n] of the centroids of masks; NaN for less than two pixels."""
    columns = mask.sum(1)
    return ratio(columns @ tangents("map_x", mask.shape[2], scene.half_tangent).values,
                 columns.sum(1), 1)


def true_range(truth: ArrayLike, scene: Scene) -> Scores:
    """Mean true z [n] of the foreground, metres."""
    mask = scene.true_mask(truth)
    return ratio((pixels(truth).astype(float) * mask).sum((1, 2)), mask.sum((1, 2)))


def lateral(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Distance of the foregrounds' centroids in x / z, times the true mean z, metres."""
    true = centroids(scene.true_mask(truth), scene)
    found = centroids(scene.share(maps) > 0.5, scene)
    return np.asarray(abs(found - true) * true_range(truth, scene))


def mirror_fraction(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Share of the foreground at the mirror image of the truth (`ghost` of the judge): 0 at the
    truth only, 0.5 as much on either side, 1 at the mirror image only. For `|x|` > 0.3 m, else
    NaN."""
    true, share = scene.true_mask(truth), scene.share(maps).astype(float)
    mirror = true[:, :, ::-1]
    x_m = abs(centroids(true, scene)) * true_range(truth, scene)
    out = ratio((share * (mirror & ~true)).sum((1, 2)), (share * (mirror ^ true)).sum((1, 2)), 1)
    return np.where(x_m > SIDE_M, out, np.nan)


def blurred(table: Scores) -> Scores:
    """Means [n, N - 10, N - 10] by a Gaussian window of 11 x 11 pixels, sigma 1.5."""
    x = np.arange(WINDOW) - WINDOW // 2
    weights = np.exp(-x ** 2 / (2 * SIGMA ** 2))
    weights /= weights.sum()
    for axis in (1, 2):
        table = np.asarray(sliding_window_view(table, WINDOW, axis) @ weights)
    return table


def ssim_fg(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Structural similarity (Wang et al., IEEE TIP 13, 600, 2004; K1 0.01, K2 0.03, population
    covariance, data range far_m), mean over the true foreground dilated by the window. NaN for
    maps below 11 x 11."""
    a, b, true = scene.clipped(maps), pixels(truth), scene.true_mask(truth)
    out = np.full(len(a), np.nan)
    if a.shape[1] < WINDOW:
        return out
    c1, c2 = (0.01 * scene.far_m) ** 2, (0.03 * scene.far_m) ** 2
    for first in range(0, len(a), 64):  # records at once, to bound the memory
        rows = slice(first, first + 64)
        x, y, near = a[rows].astype(float), b[rows].astype(float), true[rows]
        mx, my = blurred(x), blurred(y)
        var = blurred(x * x) - mx ** 2 + blurred(y * y) - my ** 2
        covariance = blurred(x * y) - mx * my
        ssim = ((2 * mx * my + c1) * (2 * covariance + c2)
                / ((mx ** 2 + my ** 2 + c1) * (var + c2)))
        for axis in (1, 2):
            near = sliding_window_view(near, WINDOW, axis).any(-1)
        out[rows] = ratio((ssim * near).sum((1, 2)), near.sum((1, 2)))
    return out
