# SPDX-License-Identifier: MIT
"""Baseline estimators (recon/models), which predict maps from counts and radar power without
aligning them to the range of the body. t and f are the tensors and the metadata of an estimator.
[n, d] means n records with d values."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .method import Array, network

__all__ = ["predict"]


def predict(t: dict[str, Array], f: dict[str, Any], counts: Array, power: Array) -> Array:
    """Predicts maps [n, pixels], m, from counts [n, bins] and radar power [n, points]."""
    x, kind = scaled(t, f, counts, power), f["model"]
    if kind in ("mean", "empty"):
        return np.repeat(t["model/map_m"][None], len(x), 0)
    if kind == "ridge":
        return np.asarray(t["model/offset_m"] + x @ t["model/weights"])
    if kind == "nearest":
        return nearest(t["model/inputs"], t["model/maps_m"], f["model/neighbours"], x)
    output = network(t, "model", x)
    if kind == "pca-mlp":
        return np.asarray(t["model/components/mean"] + output @ t["model/components/basis"])
    if kind == "mlp-mask":
        logits, depth = np.split(output, 2, 1)
        with np.errstate(over="ignore"):
            mask = 1 / (1 + np.exp(-logits)) > f["model/threshold"]
        return np.where(mask, np.maximum(depth, 1e-3), t["model/background_m"])
    return output


def scaled(t: dict[str, Array], f: dict[str, Any], counts: Array, power: Array) -> Array:
    """Returns the inputs [n, bins + points], scaled so that both sensors have similar weights."""
    scalings: dict[str, Callable[[Array], Any]] = {
        "plain": lambda x: x, "sqrt": lambda x: np.sqrt(np.maximum(x, 0)), "record": normalised,
        "root": lambda x: np.sqrt(np.maximum(normalised(x), 0))}
    scaling = scalings[f["scaling"]]
    inputs = [(counts, f["features/spd_gain"])] * (f["inputs"] != "radar") + [
        (power, f["features/radar_gain"])] * (f["inputs"] != "spd")
    gains = np.repeat([gain for _, gain in inputs], [x.shape[1] for x, _ in inputs])
    return np.asarray((np.concatenate([scaling(x) for x, _ in inputs], 1) - t["features/centre"])
                      * gains, np.float32)


def normalised(x: Array) -> Array:
    """Subtracts the upper median of each row [n, d], then divides each row by its sum."""
    x = x - np.sort(x, 1)[:, [x.shape[1] // 2]]
    total = x.sum(1, keepdims=True, dtype=float)
    return np.where(total > 0, x / np.where(total > 0, total, 1), 0)


def nearest(inputs: Array, maps: Array, neighbours: int, x: Array) -> Array:
    """For each record x [n, d], returns a weighted mean of the maps of the nearest training
    records, in which nearer records have higher weights. `inputs` [m, d] and `maps` [m, pixels]
    belong to the training records."""
    distance = (inputs.astype(float) ** 2).sum(1) - 2 * x.astype(float) @ inputs.T.astype(float)
    order = np.argsort(distance, 1, kind="stable")[:, :neighbours]
    farther = np.take_along_axis(distance, order, 1)
    farther -= farther[:, :1]
    weights = np.exp(-farther / np.maximum(farther.sum(1, keepdims=True) / (3 * neighbours), 1e-30))
    return np.asarray(np.einsum("nk,nkp->np", weights / weights.sum(1, keepdims=True), maps[order]))
