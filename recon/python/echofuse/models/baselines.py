# SPDX-License-Identifier: MIT
"""Baselines of the method (recon/models): maps from counts and power as they are. [n, d]: n records
of d values; t and f are the tensors and facts of one estimator."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .method import Array, network


def predict(t: dict[str, Array], f: dict[str, Any], counts: Array, power: Array) -> Array:
    """counts [n, bins], power [n, points]: maps [n, pixels] in metres."""
    x, kind = scaled(t, f, counts, power), f["model"]
    if kind in ("mean", "empty"):
        return np.repeat(t["model/map_m"][None], len(x), 0)
    if kind == "ridge":
        return np.asarray(t["model/offset_m"] + x @ t["model/weights"])
    if kind == "nearest":
        return nearest(t["model/inputs"], t["model/maps_m"], f["model/neighbours"], x)
    answer = network(t, "model", x)
    if kind == "pca-mlp":
        return np.asarray(t["model/components/mean"] + answer @ t["model/components/basis"])
    if kind == "mlp-mask":
        odds, depth = np.split(answer, 2, 1)
        with np.errstate(over="ignore"):
            there = 1 / (1 + np.exp(-odds)) > f["model/threshold"]
        return np.where(there, np.maximum(depth, 1e-3), t["model/background_m"])
    return answer


def scaled(t: dict[str, Array], f: dict[str, Any], counts: Array, power: Array) -> Array:
    """[n, bins + points]: each sensor brought to a common strength, so that neither drowns the
    other."""
    strengths: dict[str, Callable[[Array], Any]] = {
        "plain": lambda x: x, "sqrt": lambda x: np.sqrt(np.maximum(x, 0)), "record": normalised,
        "root": lambda x: np.sqrt(np.maximum(normalised(x), 0))}
    strength = strengths[f["scaling"]]
    taken = [(counts, f["features/spd_gain"])] * (f["inputs"] != "radar") + [
        (power, f["features/radar_gain"])] * (f["inputs"] != "spd")
    gains = np.repeat([gain for _, gain in taken], [x.shape[1] for x, _ in taken])
    return np.asarray((np.concatenate([strength(x) for x, _ in taken], 1) - t["features/centre"])
                      * gains, np.float32)


def normalised(x: Array) -> Array:
    """[n, d]: minus the median of each row, the upper one of two, divided by what is left."""
    x = x - np.sort(x, 1)[:, [x.shape[1] // 2]]
    total = x.sum(1, keepdims=True, dtype=float)
    return np.where(total > 0, x / np.where(total > 0, total, 1), 0)


def nearest(inputs: Array, maps: Array, neighbours: int, x: Array) -> Array:
    """The mean map of the nearest training records [m, d], the nearer the heavier."""
    distance = (inputs.astype(float) ** 2).sum(1) - 2 * x.astype(float) @ inputs.T.astype(float)
    order = np.argsort(distance, 1, kind="stable")[:, :neighbours]
    farther = np.take_along_axis(distance, order, 1)
    farther -= farther[:, :1]
    weights = np.exp(-farther / np.maximum(farther.sum(1, keepdims=True) / (3 * neighbours), 1e-30))
    return np.asarray(np.einsum("nk,nkp->np", weights / weights.sum(1, keepdims=True), maps[order]))
