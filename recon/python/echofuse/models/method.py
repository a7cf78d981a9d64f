# SPDX-License-Identifier: MIT
"""Implements the method of recon/method/method.cpp in NumPy, with the same equation numbers:

  (1) n_i = N_i - B_i - median      counts above the background
  (2) r = sum n_i r_i / sum n_i     range of the body, over |r_i - r| < body_m
  (3) h(d) = n(r + d) / sum n       aligned histogram; for zones h_k(d) = n_k(r + d) / sum n
  (4) g(d) = p(r + d) / sum p       aligned profile
  (5) R - r = b x / r + O(b^2)      R: range from the radar, b to the left of the detector
  (6) c(s) = <h * psf, g(. + s)> / (|h * psf| |g|)     estimator of (5), over shifts s
  (7) u = argmax sum (A - d) Re(c_d e^-i pi d u)       direction of the body from A antennas
  (8) x, z - r = place network      (c, h, h_k, g, antennas, r)
  (9) mask, depth = mean + amplitudes x components     in a frame that moves with the body
 (10) map = z + depth / mask where mask > threshold, else the background

The C++ code is faster; this code is simpler. [n, d] means n records with d values."""
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runs import PS_PER_M

__all__ = ["Array", "Method", "network"]

Array = NDArray[Any]
TAPS = np.arange(-7, 9)  # offsets of the interpolation taps, in profile points


class Method:
    """Applies the method with the tensors t, the metadata f and the constants c of one estimator
    (recon/method/constants.hpp)."""

    def __init__(self, t: dict[str, Array], f: dict[str, Any]) -> None:
        self.t, self.f, self.size = t, f, f["scene/map_size"]
        self.c = {name[17:]: value for name, value in f.items()
                  if name.startswith("alignment/config/")}

    def axis(self, name: str) -> tuple[int, float, float]:
        """Returns the count, the start and the step of a sensor's axis."""
        return (self.f[f"axes/{name}/count"], self.f[f"axes/{name}/start"],
                self.f[f"axes/{name}/step"])

    def predict(self, counts: Array, power: Array, lags: Array, zones: Array) -> Array:
        """Predicts maps [n, pixels], m, from counts [n, bins], radar power [n, points], antenna
        lags [n, points, 2 D + 1] and zone counts [n, zones, bins]."""
        return self.draw(np.array([self.features(*record)
                                   for record in zip(counts, power, lags, zones)]))

    def features(self, counts: Array, power: Array, lags: Array, zones: Array) -> Array:
        """Returns the network inputs [inputs] of one record, computed from counts [bins], radar
        power [points], antenna lags [points, 2 D + 1] and zone counts [zones, bins]. All inputs are
        0 if no body is found."""
        c, (bins, start, step) = self.c, self.axis("spd")
        no_body = np.zeros(self.t["model/centre"].size, np.float32)
        first_m, step_m = (start + 0.5 * step) / PS_PER_M, step / PS_PER_M
        n = counts - self.t["alignment/counts"]  # equation (1): counts above the background
        n = n - np.sort(n)[bins // 2]
        begin, end, centre, at = 0, bins, 0.0, np.arange(bins)  # equation (2): range
        for i in range(c["centroid_passes"] + 1):
            weight = (n if i else np.maximum(n, 0))[begin:end].astype(float)
            if weight.sum() <= 0:
                return no_body
            centre, all_counts, body, width = (weight @ at[begin:end] / weight.sum(),
                                               counts[begin:end].sum(), weight.sum(), len(weight))
            begin = int(np.clip(centre - c["body_m"] / step_m, 0, bins))
            end = int(np.clip(centre + c["body_m"] / step_m + 1, 0, bins))
        r = np.float32(first_m + centre * step_m)
        # The median of Poisson counts is up to ln 2 below their mean.
        level = np.clip((n.sum() - body) / max(bins - width, 1), 0, np.log(2))
        if not body - level * width > c["significance"] * np.sqrt(all_counts):
            return no_body
        h = self.aligned_counts(r, n, c["histogram_step_m"])  # equation (3): histogram
        of_zones = [np.zeros(0)]
        if len(zones):
            above = zones - self.t["alignment/zones"].reshape(zones.shape)
            of_zones += [self.aligned_counts(r, n_k - np.sort(n_k)[bins // 2], c["zone_step_m"])
                         for n_k in above]
        total = h.sum() if h.sum() > 0 else 1
        h, of_radar = h / total, [np.zeros(0)]
        if power.size:
            g, points = self.profile(r, power)  # equation (4): aligned profile
            of_radar = [self.correlation(h, g, points), g]
        features = [*of_radar[:-1], h, np.concatenate(of_zones) / total, of_radar[-1],
                    self.antennas(r, lags), [r]]
        return np.asarray(np.concatenate(features), np.float32)

    def aligned_counts(self, r: np.floating[Any], n: Array, bin_m: float) -> Array:
        """Resamples counts n [bins] to bins of width bin_m, centred on the range r."""
        c, (bins, start, step) = self.c, self.axis("spd")
        columns = np.arange(round(2 * c["histogram_m"] / bin_m) + 1)
        first_m, step_m = (start + 0.5 * step) / PS_PER_M, step / PS_PER_M
        edges = (r - c["histogram_m"] - first_m + bin_m * columns) / step_m + 0.5
        running = np.concatenate([[0], np.cumsum(n, dtype=np.float32)])
        return np.asarray(np.diff(np.interp(edges, np.arange(bins + 1), running)))

    def profile(self, r: np.floating[Any], power: Array) -> tuple[Array, Array]:
        """Equation (4): returns the aligned profile [k], and the ranges of its points relative to r
        [k], m."""
        c, (count, start, step) = self.c, self.axis("radar")
        apart = step * np.ceil(c["least_profile_step_m"]
                               / step) / (2 if step >= c["coarse_step_m"] else 1)
        points = c["profile_from_m"] + apart * np.arange(
            1 + int((c["profile_to_m"] - c["profile_from_m"]) / apart))
        at = (r + points - start) / step
        x = at[:, None] - (np.floor(at)[:, None] + TAPS)  # Lanczos interpolation
        index = (np.floor(at)[:, None] + TAPS).astype(int)
        above = power - self.t["alignment/power"]
        p = np.where((index >= 0) & (index < count), above[np.clip(index, 0, count - 1)], 0)
        g = (np.sinc(x) * np.sinc(x / 8) * p).sum(1)
        total = np.maximum(g, 0).sum()
        return g / total if total > 0 else g, points

    def correlation(self, h: Array, g: Array, points: Array) -> Array:
        """Equations (5) and (6): convolves the histogram h with the radar response, and returns the
        normalised correlation of the result with the profile g [k] for each shift [shifts],
        starting with the largest shift."""
        c, apart, step = self.c, points[1] - points[0], self.c["histogram_step_m"]
        near, far = int(np.floor(c["shift_from_m"] / apart)), int(np.ceil(c["shift_to_m"] / apart))
        shifts = far - near + 1
        positions = points[0] + apart * (np.arange(len(points) + shifts - 1) - far)
        within = step * ((np.arange(4) + 0.5) / 4 - 0.5)  # spreads counts evenly over their bins
        centres = -c["histogram_m"] + step * (np.arange(len(h)) + 0.5)
        resolution = c["steps_a_resolution"] * self.axis("radar")[2]
        expected = h @ (np.sinc((positions - centres[:, None] - within[:, None, None])
                                / resolution) ** 2).mean(0)
        windows = np.lib.stride_tricks.sliding_window_view(expected, len(g))
        norm = np.sqrt((g @ g) * (windows**2).sum(1))
        return np.divide(windows @ g, norm, out=np.zeros(shifts), where=norm > 0)

    def antennas(self, r: np.floating[Any], lags: Array) -> Array:
        """Equation (7): returns the direction cosine u, the product u r, the lags summed over the
        body, and the shortest lags summed over each range interval. All lags are normalised to the
        power of the body, and the horizontal lags are rotated to direction u. Returns an empty
        array if there are no antennas. The shape of `lags` is [points, 2 D + 1]."""
        if "alignment/lags" not in self.t or lags.size == 0:
            return np.zeros(0)
        c, (count, start, step) = self.c, self.axis("array")
        # The vertical lags follow the horizontal lags.
        up = int(self.f["axes/array/quantity"].partition(", ")[2].partition(" ")[0] or 0)
        across = int(self.f["axes/array/scale"]) - up
        values = (lags - self.t["alignment/lags"].reshape(lags.shape)).astype(float)
        # complex lags [points, D + 1]; lag 0 is the power
        z = np.concatenate([values[:, :1] + 0j, values[:, 1::2] + 1j * values[:, 2::2]], 1)
        at = start + step * np.arange(count) - r
        inside = np.clip(np.minimum(at - c["profile_from_m"], c["profile_to_m"] - at) / step + 0.5,
                         0, 1)
        every, part_m = inside @ z, max(step, c["least_part_m"])
        parts = c["part_from_m"] + part_m * np.arange(
            1 + int((c["part_to_m"] - c["part_from_m"]) / part_m + 1e-9))
        short, short_up = min(across, c["lags_of_parts"]), min(up, c["lags_of_parts"])
        if not every[0].real > 0:
            return np.zeros(2 + 2 * (across + up) + len(parts) * 2 * (short + short_up))
        d = np.arange(1, across + 1)
        grid = -1 + 2 * (np.arange(c["directions"]) + 0.5) / c["directions"]
        u = grid[np.argmax([((across + 1 - d) * (every[d] * np.exp(-1j * np.pi * d * u)).real).sum()
                            for u in grid])]
        for _ in range(c["refinements"]):
            turned, weight = every[d] * np.exp(-1j * np.pi * d * u), across + 1 - d
            slope, curve = (weight * np.pi * d
                            * turned.imag).sum(), -(weight * (np.pi * d) ** 2 * turned.real).sum()
            if not curve < 0:
                break
            u = np.clip(u - np.clip(slope / curve, -0.02, 0.02), -1, 1)
        out = [u, u * r]
        weights = np.maximum(1 - np.abs(at - parts[:, None]) / part_m, 0) * (inside > 0)
        for total, max_lag, max_lag_up in [(every, across,
                                           up), *((w @ z, short, short_up) for w in weights)]:
            turned = np.concatenate([total[1:max_lag + 1] * np.exp(-1j * np.pi * d[:max_lag] * u),
                                     total[across + 1:across + 1 + max_lag_up]]) / every[0].real
            out += turned.view(float).tolist()
        return np.array(out)

    def networks(self, x: Array, group: str) -> Array:
        """Returns the outputs [n, outputs] for the inputs [n, inputs], averaged over the networks
        of a group."""
        return np.asarray(np.mean([network(self.t, f"{group}/{k}", x)
                                   for k in range(self.f[f"{group}/networks"])], 0))

    def draw(self, inputs: Array) -> Array:
        """Equations (8) to (10): converts network inputs [n, inputs] to maps [n, pixels], m."""
        maps = np.repeat(self.t["model/background_m"][None], len(inputs), 0)
        bodies = np.flatnonzero(inputs[:, -1])
        standard = (inputs[bodies] - self.t["model/centre"]) / self.t["model/deviation"]
        right, behind = self.networks(standard, "model/place").T  # equation (8): position
        r, nearest = inputs[bodies, -1], self.f["model/nearest_m"]
        tangent, z = right / np.maximum(r, nearest), np.maximum(r + behind, nearest)
        # equation (9): mask and depth in the frame of the body
        mask, depth = (self.t[f"model/{name}/mean"][None].repeat(len(bodies), 0)
                       for name in ("masks", "depths"))
        if self.f["model"] == "factorised":
            found, split = self.networks(standard,
                                         "model/shape"), self.t["model/masks/basis"].shape[0]
            units = {name: max(self.t[f"model/{name}/deviation"][0], 1e-6)
                     for name in ("masks", "depths")}
            mask = mask + units["masks"] * found[:, :split] @ self.t["model/masks/basis"]
            depth = depth + units["depths"] * found[:, split:] @ self.t["model/depths/basis"]
        keys = ("rows", "columns", "left_m", "top_m", "pitch_m")
        # size and position of the cell grid around the body
        rows, columns, left, top, pitch = (self.f[f"model/frame/{key}"] for key in keys)
        half = self.f["scene/map_half_tangent"]
        # tangents of the pixel centres
        pixel = half * ((2 * np.arange(self.size) + 1) / self.size - 1)
        for i, row in enumerate(bodies):  # equation (10): map of each body
            across = interpolation(((pixel - tangent[i]) * z[i] - left) / pitch, columns)
            down = interpolation((-pixel * z[i] - top) / pitch, rows)
            m = down @ mask[i].reshape(rows, columns) @ across.T
            drawn = (m > self.f["model/threshold"]).ravel()
            ahead = (down @ depth[i].reshape(rows, columns) @ across.T).ravel()
            maps[row, drawn] = z[i] + ahead[drawn] / m.ravel()[drawn]
        return maps


def network(t: dict[str, Array], group: str, x: Array) -> Array:
    """Returns the outputs [n, outputs] of a ReLU network for the inputs [n, inputs], in the units
    of the training targets."""
    layers = t[f"{group}/widths"].size - 1
    for i in range(layers):
        x = x @ t[f"{group}/layer{i}/weights"] + t[f"{group}/layer{i}/biases"]
        x = np.maximum(x, 0) if i + 1 < layers else x
    return np.asarray(t[f"{group}/centre"] + t[f"{group}/spread"] * x)


def interpolation(at: Array, cells: int) -> Array:
    """Returns the weights [pixels, cells] for linear interpolation between the cells at each
    position. At positions outside the cells, all weights are 0."""
    low = np.floor(at).astype(int)
    inside = (low >= 0) & (low + 1 < cells)
    out = np.zeros((len(at), cells))
    rows = np.flatnonzero(inside)
    out[rows, low[rows]], out[rows, low[rows] + 1] = 1 - (at - low)[rows], (at - low)[rows]
    return out
