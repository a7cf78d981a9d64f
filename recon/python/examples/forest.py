# SPDX-License-Identifier: MIT
"""Bench method with scikit-learn (python3-sklearn): extremely randomised trees predict 64 principal
components of the map from the histogram and the profile. Run it in the folder of this file:

    echofuse-bench pareto TRAIN TEST --out mine.csv --markdown --methods nearest forest:Forest
"""
import numpy as np
from sklearn.decomposition import PCA
from sklearn.ensemble import ExtraTreesRegressor


class Forest:
    def __init__(self, seed: int = 1) -> None:
        self.trees = ExtraTreesRegressor(100, min_samples_leaf=3, random_state=seed, n_jobs=1)

    def inputs(self, run) -> np.ndarray:
        """Returns the inputs [n, bins + points]. In each record, the data of each sensor are
        normalised separately."""
        counts = run.photons().reshape(len(run), -1)
        parts = [counts] + ([run.power()] if "radar" in run.axes else [])
        return np.hstack([part / (np.abs(part).sum(1, keepdims=True) + 1e-9) for part in parts])

    def fit(self, run, rows: np.ndarray) -> None:
        maps = np.nan_to_num(run.maps()[rows])
        self.size = maps.shape[1]
        self.nearest = 0.5 * float(np.median(maps[maps > 0]))  # smaller depths count as no return
        self.components = PCA(min(64, len(maps) - 1),
                              random_state=0).fit(maps.reshape(len(maps), -1))
        self.trees.fit(self.inputs(run)[rows],
                       self.components.transform(maps.reshape(len(maps), -1)))

    def predict(self, run) -> np.ndarray:
        """Returns the maps [n, N, N], m, with NaN for no return."""
        maps = self.components.inverse_transform(self.trees.predict(self.inputs(run)))
        return np.where(maps > self.nearest, maps,
                        np.nan).reshape(-1, self.size, self.size).astype(np.float32)
