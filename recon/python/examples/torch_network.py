# SPDX-License-Identifier: MIT
"""Bench method with PyTorch (python3-torch), to compare your own network with those of echofuse.
Run it in the folder of this file:

    echofuse-bench pareto TRAIN TEST --out mine.csv --methods nearest torch_network:Network
"""
import numpy as np
import torch
from torch import nn


class Network:
    """Network that predicts a mask and depths from the histogram and the profile. Its layers have
    256, 256 and 128 units."""

    def __init__(self, seed: int = 1, epochs: int = 40) -> None:
        torch.manual_seed(seed)
        self.epochs = epochs

    def inputs(self, run) -> torch.Tensor:
        """Returns the inputs [n, bins + points]. In each record, the data of each sensor are
        normalised separately."""
        counts = run.photons().reshape(len(run), -1)
        parts = [counts] + ([run.power()] if "radar" in run.axes else [])
        # interpolated counts may be negative
        roots = [np.sqrt(np.maximum(part, 0)) for part in parts]
        return torch.tensor(np.hstack([part / (np.linalg.norm(part, axis=1, keepdims=True) + 1e-9)
                                       for part in roots]))

    def fit(self, run, rows: np.ndarray) -> None:
        x, maps = self.inputs(run)[rows], run.maps()[rows]
        self.size = maps.shape[1]
        foreground = torch.tensor(np.isfinite(maps).reshape(len(maps), -1), dtype=torch.float32)
        depth = torch.tensor(np.nan_to_num(maps).reshape(len(maps), -1))
        self.mean, self.scale = x.mean(0), x.std(0) + 0.05 * x.std(0).median() + 1e-9
        self.depth_mean = float(depth[foreground > 0].mean())
        pixels = self.size ** 2
        self.net = nn.Sequential(nn.Linear(x.shape[1], 256), nn.ReLU(), nn.Linear(256, 256),
                                 nn.ReLU(), nn.Linear(256, 128), nn.Linear(128, 2 * pixels))
        steps = torch.optim.AdamW(self.net.parameters(), 1e-3, weight_decay=1e-2)
        rate = torch.optim.lr_scheduler.CosineAnnealingLR(steps, self.epochs)
        for _ in range(self.epochs):
            for batch in torch.randperm(len(x)).split(64):
                mask, off = self.net((x[batch] - self.mean) / self.scale).split(pixels, 1)
                target = foreground[batch]
                error = ((off + self.depth_mean - depth[batch])
                         * target).abs().sum() / target.sum().clamp(min=1)
                loss = nn.functional.binary_cross_entropy_with_logits(mask, target) + 0.3 * error
                steps.zero_grad()
                loss.backward()
                steps.step()
            rate.step()
        # Selects the threshold with the highest IoU. The masks of uncertain bodies are too wide.
        with torch.no_grad():
            mask = self.net((x - self.mean) / self.scale)[:, :pixels]
        self.threshold = max(torch.linspace(-2.5, 0.5, 13).tolist(), key=lambda at: float(
            (((mask > at) * foreground).sum(1) / ((mask > at)
                                             + foreground).gt(0).sum(1).clamp(min=1)).mean()))

    @torch.no_grad()
    def predict(self, run) -> np.ndarray:
        """Returns the maps [n, N, N], m, with NaN for no return."""
        mask, off = self.net((self.inputs(run) - self.mean) / self.scale).split(self.size ** 2, 1)
        maps = np.where(mask > self.threshold, off + self.depth_mean, np.nan)
        return maps.reshape(-1, self.size, self.size).astype(np.float32)
