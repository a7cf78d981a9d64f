# SPDX-License-Identifier: MIT
"""Computes scores of depth maps from arrays, e.g. in a training loop. The scores are equal to those
of `echofuse-recon evaluate` (recon/metrics).

Each score function takes predicted maps [n, N, N], the ground-truth maps [n, N, N] of the same
records, and the scene of the training maps. A map contains z in metres, starting with the top-left
pixel; NaN or 0 means no return. The function returns float64 [n], with NaN for maps without a
defined score. It raises ValueError if the shapes differ, or if the values are not metres.

>>> scene = metrics.Scene.of_maps(run.maps(split.train))
>>> np.nanmean(metrics.iou(maps, run.maps(split.test), scene))
"""
from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from .runs.arguments import ComparedByValue, number, plain
from .runs.axis import tangents

__all__ = ["Scene", "depth_mae_m", "ghost", "iou", "lateral_m", "ssim_fg"]

Scores = NDArray[np.float64]
STEP_M = 0.1  # minimum distance between foreground and background, m
BEHIND = 0.25  # maximum fraction of the foreground behind the background, weighted by distance
# limits in holds_returns(): depth relative to foreground_m, and fraction of pixels below this depth
NEAREST, NEARER = 0.125, 0.1
SIDE_M = 0.3  # minimum |x| at which a body and its mirror image are distinct, m
WINDOW, SIGMA = 11, 1.5  # width and standard deviation of the SSIM window, pixels


# limits of the values of a Scene (acquire/measurement/depth_map.hpp)
LIMITS = ("foreground_m", 0, 200), ("half_tangent", 0.02, 3), ("far_m", 0.1, 65)
MIN_M, MAX_M, MAX_MEDIAN_M = -100, 1e6, 200  # limits of depths (recon/maps/written_maps.cpp)


def pixels(maps: ArrayLike, name: str = "maps") -> NDArray[np.float32]:
    """Replaces NaN and masked pixels in maps [n, N, N] with 0. Raises ValueError if the maps have
    another shape, or if their values are not depths in metres."""
    given = plain(name, maps)[0]
    table = np.where(np.isnan(given), np.float32(0), given).astype(np.float32)
    if table.ndim != 3 or table.shape[1] != table.shape[2]:
        raise ValueError(f"{name}: shape {list(table.shape)} (expected [n, N, N])")
    if given.dtype == bool:
        raise ValueError(f"{name}: {given.dtype} (expected depths in metres)")
    if bad := np.argwhere(~((table >= MIN_M) & (table < MAX_M)))[:1].tolist():
        raise ValueError(f"{name}: map {bad[0][0]} has an impossible depth: {table[*bad[0]]:g} m")
    far = 2 * (table > MAX_MEDIAN_M).sum((1, 2)) > (table > 0).sum((1, 2))
    if far.any():
        raise ValueError(f"{name}: the median depth of map {far.argmax()} is above {MAX_MEDIAN_M} "
                         "m; expected metres, not millimetres")
    return table


def score(function: Callable[..., Scores]) -> Callable[[ArrayLike, ArrayLike, Scene], Scores]:
    """Decorates a score function, which then raises ValueError if the shapes of the maps, the
    ground-truth maps and the scene differ."""
    @functools.wraps(function)
    def checked(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
        true = scene._pixels(truth, "truth")
        return function(scene._pixels(maps, "maps", len(true)), true, scene)
    return checked


def ratio(numerator: NDArray[Any], denominator: NDArray[Any], minimum: float = 0) -> Scores:
    """Returns numerator / denominator, or NaN where the denominator is at most `minimum`."""
    valid = denominator > minimum
    return np.where(valid, numerator / np.where(valid, denominator, 1), np.nan)


@dataclass(frozen=True, eq=False)
class Scene(ComparedByValue):
    """Background and foreground depths of the training maps (recon/metrics/scene_model.hpp). Raises
    ValueError if a value is impossible."""

    background_m: NDArray[np.float32]  #: z of the background [N, N], m; 0 or NaN: no background
    foreground_m: float  #: mean z of the foreground, m; 0: no separable body
    half_tangent: float = 0.55  #: x / z at the right edge of the maps
    far_m: float = 6.0  #: maximum z of a map, m

    def __post_init__(self) -> None:
        background = pixels([self.background_m], "background_m")[0]
        object.__setattr__(self, "background_m", background)
        for name, *limits in LIMITS:
            number(name, getattr(self, name), limits=limits)

    @classmethod
    def of_maps(cls, maps: ArrayLike, half_tangent: float = 0.55, far_m: float = 6.0) -> Scene:
        """Learns the scene from training maps [n, N, N], n >= 1 (recon/metrics/scene_model.cpp)."""
        table = pixels(maps)
        if not len(table):
            raise ValueError("maps: expected at least one map")
        sample = table[::max(1, len(table) // 1000)]
        background = np.partition(sample, len(sample) // 2, axis=0)[len(sample) // 2]
        background[5 * np.count_nonzero(table <= 0, axis=0) >= len(table)] = 0
        scene = cls(background, 1.0, half_tangent, far_m)
        mask = scene.true_mask(table)
        before = np.where(mask, background - table, 0)
        behind = -np.minimum(before, 0)[:, background > 0].sum(dtype=float)
        if not mask.any() or behind >= BEHIND * abs(before).sum(dtype=float):
            return cls(background, 0.0, half_tangent, far_m)
        mean = float(np.float32(table[mask].mean(dtype=float)))
        return cls(background, mean, half_tangent, far_m)

    def _pixels(self, maps: ArrayLike, name: str = "maps",
                count: int | None = None) -> NDArray[np.float32]:
        """Returns maps [count, N, N], in which NaN and masked pixels are replaced with 0. Raises
        ValueError if their number or their size differs from `count` or the scene."""
        table = pixels(maps, name)
        expected = [len(table) if count is None else count, *self.background_m.shape]
        if [*table.shape] != expected:
            raise ValueError(f"{name}: shape {list(table.shape)} (expected {expected}, as in the "
                             "ground-truth maps and the scene)")
        return table

    def true_mask(self, truth: ArrayLike) -> NDArray[np.bool_]:
        """Returns the foreground mask [n, N, N] of ground-truth maps. A return belongs to the
        foreground if it is more than 0.1 m from the background, or if its pixel has no
        background."""
        z, b = self._pixels(truth), self.background_m
        return (self.foreground_m > 0) & (z > 0) & ((b <= 0) | (abs(z - b) > np.float32(STEP_M)))

    def holds_returns(self, maps: ArrayLike) -> NDArray[np.bool_]:
        """For each map [n], returns whether its values are depths of returns, i.e. whether at most
        10 % of the values in pixels without background are below foreground_m / 8. In these pixels,
        maps predicted by a regression contain many values near 0."""
        z = self._pixels(maps)
        open_ = (self.background_m <= 0) & (z > 0)
        nearer = open_ & (z < np.float32(NEAREST) * np.float32(self.foreground_m))
        return np.asarray(nearer.sum((1, 2)) <= NEARER * open_.sum((1, 2)))

    def share(self, maps: ArrayLike) -> NDArray[np.float32]:
        """Returns the depth [n, N, N] on a relative scale: 0 is the background, 1 the mean depth of
        the foreground. Pixels above 0.5 are foreground. In pixels without a background, each return
        has the value 1."""
        z, b = self.clipped(maps), self.background_m
        if self.foreground_m <= 0:
            return np.zeros_like(z)
        distance = np.float32(self.foreground_m) - b
        separable = abs(distance) > np.float32(STEP_M)
        share = np.where(separable, z - b, 0) / np.where(separable, distance, 1)
        returns = self.holds_returns(z)[:, None, None] & (b <= 0)
        return np.where(returns, z > 0, share).astype(np.float32)

    def clipped(self, maps: ArrayLike) -> NDArray[np.float32]:
        """Clips the depths of maps [n, N, N] to the interval from 0 to far_m."""
        return self._pixels(maps).clip(0, np.float32(self.far_m))


@score
def iou(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Returns the intersection over union [n] of the predicted and the ground-truth foreground."""
    true, found = scene.true_mask(truth), scene.share(maps) > 0.5
    return ratio((true & found).sum((1, 2)), (true | found).sum((1, 2)))


@score
def depth_mae_m(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Returns the mean absolute depth error [n], m, over the pixels in both the predicted and the
    ground-truth foreground."""
    both = scene.true_mask(truth) & (scene.share(maps) > 0.5)
    error = abs(scene.clipped(maps).astype(float) - pixels(truth))
    return ratio((error * both).sum((1, 2)), both.sum((1, 2)))


def centroids(mask: NDArray[np.bool_], scene: Scene) -> Scores:
    """Returns x / z [n] of the centroid of each mask; NaN for a mask with fewer than two pixels."""
    columns = mask.sum(1)
    return ratio(columns @ tangents("map_x", mask.shape[2], scene.half_tangent).values,
                 columns.sum(1), 1)


def true_range(truth: ArrayLike, scene: Scene) -> Scores:
    """Returns the mean z [n] of the ground-truth foreground, m."""
    mask = scene.true_mask(truth)
    return ratio((pixels(truth).astype(float) * mask).sum((1, 2)), mask.sum((1, 2)))


@score
def lateral_m(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Returns the lateral distance [n], m, between the centroids of the predicted and the
    ground-truth foreground, evaluated at the mean z of the ground-truth foreground."""
    true = centroids(scene.true_mask(truth), scene)
    found = centroids(scene.share(maps) > 0.5, scene)
    return np.asarray(abs(found - true) * true_range(truth, scene))


@score
def ghost(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Returns the fraction [n] of the predicted foreground at the mirrored position. 0: all is at
    the true position; 1: all is mirrored; NaN: `|x|` of the true centroid is below 0.3 m."""
    true, share = scene.true_mask(truth), scene.share(maps).astype(float)
    mirror = true[:, :, ::-1]
    x_m = abs(centroids(true, scene)) * true_range(truth, scene)
    out = ratio((share * (mirror & ~true)).sum((1, 2)), (share * (mirror ^ true)).sum((1, 2)), 1)
    return np.where(x_m > SIDE_M, out, np.nan)


def blurred(table: Scores) -> Scores:
    """Returns Gaussian-weighted means [n, N - 10, N - 10] (window 11 x 11, sigma 1.5)."""
    x = np.arange(WINDOW) - WINDOW // 2
    weights = np.exp(-x ** 2 / (2 * SIGMA ** 2))
    weights /= weights.sum()
    for axis in (1, 2):
        table = np.asarray(sliding_window_view(table, WINDOW, axis) @ weights)
    return table


@score
def ssim_fg(maps: ArrayLike, truth: ArrayLike, scene: Scene) -> Scores:
    """Returns the mean SSIM [n] over the ground-truth foreground dilated by the SSIM window (Wang
    et al., IEEE TIP 13, 600, 2004; K1 0.01, K2 0.03, population covariance, data range far_m).
    Returns NaN for maps smaller than 11 x 11."""
    a, b, true = scene.clipped(maps), pixels(truth), scene.true_mask(truth)
    out = np.full(len(a), np.nan)
    if a.shape[1] < WINDOW:
        return out
    c1, c2 = (0.01 * scene.far_m) ** 2, (0.03 * scene.far_m) ** 2
    for first in range(0, len(a), 64):  # processes 64 records at a time to limit the memory use
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
