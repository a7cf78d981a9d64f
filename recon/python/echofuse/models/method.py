# SPDX-License-Identifier: MIT
"""The method of recon/method/method.cpp in NumPy, step by step and with its numbers of equations:

  (1) n_i = N_i - B_i - median      counts above what is always there
  (2) r = sum n_i r_i / sum n_i     range of the body, over |r_i - r| < body_m
  (3) h(d) = n(r + d) / sum n       histogram about it; of zones h_k(d) = n_k(r + d) / sum n
  (4) g(d) = p(r + d) / sum p       profile about it
  (5) R - r = b x / r + O(b^2)      the radar, b to the left, sees the body farther by this
  (6) c(s) = <h * psf, g(. + s)> / (|h * psf| |g|)     its estimator, over shifts s
  (7) u = argmax sum (A - d) Re(c_d e^-i pi d u)       direction that A antennas see
  (8) x, z - r = place network      (c, h, h_k, g, antennas, r)
  (9) mask, depth = mean + amounts x components        in a frame that moves with the body
 (10) map = z + depth / mask where mask > threshold, else the background

C++ is the faster one, this the plainer one. [n, d]: n records of d values."""
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
PS_PER_M = 2e12 / 299_792_458.0  # there and back
TAPS = np.arange(-7, 9)  # taps of the interpolation between points of a profile


class Method:
    """Method of one estimator: its tensors t, its facts f, and c, the numbers of
    recon/method/constants.hpp."""

    def __init__(self, t: dict[str, Array], f: dict[str, Any]) -> None:
        self.t, self.f, self.size = t, f, f["scene/map_size"]
        self.c = {name[17:]: value for name, value in f.items()
                  if name.startswith("alignment/config/")}

    def axis(self, name: str) -> tuple[int, float, float]:
        """How many values a sensor has, where the first one is, and the step between two."""
        return (self.f[f"axes/{name}/count"], self.f[f"axes/{name}/start"],
                self.f[f"axes/{name}/step"])

    def predict(self, counts: Array, power: Array, lags: Array, zones: Array) -> Array:
        """counts [n, bins], power [n, points], lags [n, points, 2 D + 1], zones [n, zones, bins]:
        maps [n, pixels] in metres."""
        return self.draw(np.array([self.view(*record)
                                   for record in zip(counts, power, lags, zones)]))

    def view(self, counts: Array, power: Array, lags: Array, zones: Array) -> Array:
        """Step 2 of one record, counts [bins], power [points], lags [points, 2 D + 1], zones
        [zones, bins]: what the networks take of it, [inputs]; all 0 if nobody is there."""
        c, (bins, start, step) = self.c, self.axis("spd")
        nobody = np.zeros(self.t["model/centre"].size, np.float32)
        first_m, step_m = (start + 0.5 * step) / PS_PER_M, step / PS_PER_M
        n = counts - self.t["alignment/counts"]  # (1)
        n = n - np.sort(n)[bins // 2]
        begin, end, centre, at = 0, bins, 0.0, np.arange(bins)  # (2)
        for i in range(c["centroid_passes"] + 1):
            weight = (n if i else np.maximum(n, 0))[begin:end].astype(float)
            if weight.sum() <= 0:
                return nobody
            centre, all_counts, body = (weight @ at[begin:end] / weight.sum(),
                                        counts[begin:end].sum(), weight.sum())
            begin = int(np.clip(centre - c["body_m"] / step_m, 0, bins))
            end = int(np.clip(centre + c["body_m"] / step_m + 1, 0, bins))
        r = np.float32(first_m + centre * step_m)
        if not body > c["significance"] * np.sqrt(all_counts):
            return nobody
        h = self.about(r, n, c["histogram_step_m"])  # (3)
        of_zones = [np.zeros(0)]
        if len(zones):
            above = zones - self.t["alignment/zones"].reshape(zones.shape)
            of_zones += [self.about(r, n_k - np.sort(n_k)[bins // 2], c["zone_step_m"])
                         for n_k in above]
        total = h.sum() if h.sum() > 0 else 1
        h, of_radar = h / total, [np.zeros(0)]
        if power.size:
            g, points = self.profile(r, power)  # (4)
            of_radar = [self.correlation(h, g, points), g]
        features = [*of_radar[:-1], h, np.concatenate(of_zones) / total, of_radar[-1],
                    self.antennas(r, lags), [r]]
        return np.asarray(np.concatenate(features), np.float32)

    def about(self, r: np.floating[Any], n: Array, bin_m: float) -> Array:
        """Counts n [bins] in bins of this width about r."""
        c, (bins, start, step) = self.c, self.axis("spd")
        columns = np.arange(round(2 * c["histogram_m"] / bin_m) + 1)
        first_m, step_m = (start + 0.5 * step) / PS_PER_M, step / PS_PER_M
        edges = (r - c["histogram_m"] - first_m + bin_m * columns) / step_m + 0.5
        running = np.concatenate([[0], np.cumsum(n, dtype=np.float32)])
        return np.asarray(np.diff(np.interp(edges, np.arange(bins + 1), running)))

    def profile(self, r: np.floating[Any], power: Array) -> tuple[Array, Array]:
        """(4) of power [points]: its shares at points about r, and these points (metres from r)."""
        c, (count, start, step) = self.c, self.axis("radar")
        apart = step * np.ceil(c["least_profile_step_m"]
                               / step) / (2 if step >= c["coarse_step_m"] else 1)
        points = c["profile_from_m"] + apart * np.arange(
            1 + int((c["profile_to_m"] - c["profile_from_m"]) / apart))
        at = (r + points - start) / step
        x = at[:, None] - (np.floor(at)[:, None] + TAPS)  # Lanczos: sinc with a window of sinc
        index = (np.floor(at)[:, None] + TAPS).astype(int)
        above = power - self.t["alignment/power"]
        p = np.where((index >= 0) & (index < count), above[np.clip(index, 0, count - 1)], 0)
        g = (np.sinc(x) * np.sinc(x / 8) * p).sum(1)
        total = np.maximum(g, 0).sum()
        return g / total if total > 0 else g, points

    def correlation(self, h: Array, g: Array, points: Array) -> Array:
        """(5), (6): the cosine between the profile g, at these points, and the histogram h as the
        radar would see it, at each shift [shifts]; from the longest one on."""
        c, apart, step = self.c, points[1] - points[0], self.c["histogram_step_m"]
        near, far = int(np.floor(c["shift_from_m"] / apart)), int(np.ceil(c["shift_to_m"] / apart))
        shifts = far - near + 1
        seen_at = points[0] + apart * (np.arange(len(points) + shifts - 1) - far)
        within = step * ((np.arange(4) + 0.5) / 4 - 0.5)  # counts lie anywhere in their bin
        centres = -c["histogram_m"] + step * (np.arange(len(h)) + 0.5)
        resolution = c["steps_a_resolution"] * self.axis("radar")[2]
        expected = h @ (np.sinc((seen_at - centres[:, None] - within[:, None, None])
                                / resolution) ** 2).mean(0)
        windows = np.lib.stride_tricks.sliding_window_view(expected, len(g))
        norm = np.sqrt((g @ g) * (windows**2).sum(1))
        return np.divide(windows @ g, norm, out=np.zeros(shifts), where=norm > 0)

    def antennas(self, r: np.floating[Any], lags: Array) -> Array:
        """(7) of lags [points, 2 D + 1]: the direction cosine u, u r, and the lags about the body
        in shares of its power, turned into that direction; then the shortest of them part by part.
        Empty without antennas."""
        if "alignment/lags" not in self.t or lags.size == 0:
            return np.zeros(0)
        c, (count, start, step) = self.c, self.axis("array")
        # lags upwards come last
        up = int(self.f["axes/array/quantity"].partition(", ")[2].partition(" ")[0] or 0)
        across = int(self.f["axes/array/scale"]) - up
        values = (lags - self.t["alignment/lags"].reshape(lags.shape)).astype(float)
        # [bins, D + 1]
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
        for total, most, most_up in [(every, across,
                                      up), *((w @ z, short, short_up) for w in weights)]:
            turned = np.concatenate([total[1:most + 1] * np.exp(-1j * np.pi * d[:most] * u),
                                     total[across + 1:across + 1 + most_up]]) / every[0].real
            out += turned.view(float).tolist()
        return np.array(out)

    def networks(self, x: Array, group: str) -> Array:
        """[n, inputs] to [n, outputs]: the mean answer of a group of networks."""
        return np.asarray(np.mean([network(self.t, f"{group}/{k}", x)
                                   for k in range(self.f[f"{group}/networks"])], 0))

    def draw(self, views: Array) -> Array:
        """Steps 3 to 5: views [n, inputs] to maps [n, pixels]."""
        maps = np.repeat(self.t["model/background_m"][None], len(views), 0)
        seen = np.flatnonzero(views[:, -1])
        standard = (views[seen] - self.t["model/centre"]) / self.t["model/deviation"]
        right, behind = self.networks(standard, "model/place").T  # (8)
        r, nearest = views[seen, -1], self.f["model/nearest_m"]
        tangent, z = right / np.maximum(r, nearest), np.maximum(r + behind, nearest)
        # (9)
        mask, depth = (self.t[f"model/{name}/mean"][None].repeat(len(seen), 0)
                       for name in ("masks", "depths"))
        if self.f["model"] == "factorised":
            found, split = self.networks(standard,
                                         "model/shape"), self.t["model/masks/basis"].shape[0]
            units = {name: max(self.t[f"model/{name}/deviation"][0], 1e-6)
                     for name in ("masks", "depths")}
            mask = mask + units["masks"] * found[:, :split] @ self.t["model/masks/basis"]
            depth = depth + units["depths"] * found[:, split:] @ self.t["model/depths/basis"]
        keys = ("rows", "columns", "left_m", "top_m", "pitch_m")
        # grid of the cells
        rows, columns, left, top, pitch = (self.f[f"model/frame/{key}"] for key in keys)
        half = self.f["scene/map_half_tangent"]
        # tangents of the pixels' centres
        pixel = half * ((2 * np.arange(self.size) + 1) / self.size - 1)
        for i, row in enumerate(seen):  # (10)
            across = interpolation(((pixel - tangent[i]) * z[i] - left) / pitch, columns)
            down = interpolation((-pixel * z[i] - top) / pitch, rows)
            m = down @ mask[i].reshape(rows, columns) @ across.T
            shown = (m > self.f["model/threshold"]).ravel()
            ahead = (down @ depth[i].reshape(rows, columns) @ across.T).ravel()
            maps[row, shown] = z[i] + ahead[shown] / m.ravel()[shown]
        return maps


def network(t: dict[str, Array], group: str, x: Array) -> Array:
    """[n, inputs] to [n, outputs]: rectifiers between the layers, the last one linear; in the
    targets' own units."""
    layers = t[f"{group}/widths"].size - 1
    for i in range(layers):
        x = x @ t[f"{group}/layer{i}/weights"] + t[f"{group}/layer{i}/biases"]
        x = np.maximum(x, 0) if i + 1 < layers else x
    return np.asarray(t[f"{group}/centre"] + t[f"{group}/spread"] * x)


def interpolation(at: Array, cells: int) -> Array:
    """[pixels, cells]: linear weights of the two cells beside each place; none outside the
    cells."""
    low = np.floor(at).astype(int)
    inside = (low >= 0) & (low + 1 < cells)
    out = np.zeros((len(at), cells))
    rows = np.flatnonzero(inside)
    out[rows, low[rows]], out[rows, low[rows] + 1] = 1 - (at - low)[rows], (at - low)[rows]
    return out
