# SPDX-License-Identifier: MIT
"""Fits the field of view and the time zero of each detector zone, and the exponent of the response,
to measurements of a known object.

Model of the counts of zone k in bin b:
    r_kb = sum over rays i of  w_ki a_i cos_i / R_i^2  h^g(b - zero_k - R_i / bin)
where w_ki is the weight of ray i (of G x G) in the field of zone k, a_i the albedo (1 on the
object), h the reference histogram of the chip, and g the response exponent. w is the non-negative
least squares solution with Poisson weights (computed by the accelerated projected
gradient method of Beck and Teboulle)."""
from __future__ import annotations

import json
import pathlib
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BIN_M", "Scenes", "ZoneFit", "explained", "fit_zones", "load", "response_of", "slant",
           "tangents"]

Array = NDArray[np.floating[Any]]
# number of rays per side of a field of view; tangent of its half-angle (14 % of the zone's
# sensitivity is beyond tangents of +-0.3)
G, FIELD_TANGENT = 30, 0.46
# A field is a sum of KNOTS x KNOTS hat functions. A few poses cannot determine the weight per ray.
KNOTS = 8
BIN_M = 0.0138
FIRST, LAST = 11, 60  # bins FIRST to LAST - 1 are fitted
FINE = 0.05  # step of the tabulated response, bins
EXPONENTS, ALBEDOS = (1.0, 1.35, 1.7, 2.0), (0.8, 1.2, 1.8)


def tangents(size: int, half: float) -> tuple[Array, Array]:
    """Returns the tangents x and y [size, size] of the pixel centres. Row 0 is at the top."""
    at = half * ((2 * np.arange(size) + 1) / size - 1)
    x, y = np.meshgrid(at, -at)
    return x, y


def slant() -> Array:
    """Returns the ratio of range to depth for each ray of a field [G * G]."""
    x, y = tangents(G, FIELD_TANGENT)
    return np.asarray(np.sqrt(1 + x**2 + y**2).ravel())


def response_of(reference: Array, exponent: float) -> tuple[Array, int]:
    """Computes the response [bins], normalised to a sum of 1, and the index of its peak bin, from
    the mean reference histogram."""
    above = np.clip(reference - np.median(reference[-20:]), 0, None)
    response = (above / above.sum()) ** exponent
    return response / response.sum(), int(response.argmax())


def hats() -> Array:
    """Returns the weight of each knot at each ray [G * G, KNOTS * KNOTS], for bilinear
    interpolation between the knots."""
    at = (np.arange(G) + 0.5) / G * KNOTS - 0.5
    hat = np.clip(1 - np.abs(at[:, None] - np.arange(KNOTS)), 0, None)
    return np.asarray(np.einsum("ik,jl->ijkl", hat, hat).reshape(G * G, KNOTS * KNOTS))


@dataclass(frozen=True)
class Scenes:
    """First hit of each ray [poses, G * G]: depth (m, inf: no hit), cosine of the angle of
    incidence, and whether the hit is on the object."""

    depth_m: Array
    cosine: Array
    is_object: NDArray[np.bool_]

    def unit_counts(self, response: tuple[Array, int], zero_bin: float, albedo: float) -> Array:
        """Returns the counts that each ray adds to the fitted bins [poses * bins, G * G] if its
        weight is 1. `albedo` is the ratio of the table albedo to the object albedo."""
        taps, peak = response
        fine = np.interp(np.arange(-20, 100, FINE) + peak, np.arange(len(taps)), taps)
        met = np.isfinite(self.depth_m)
        range_m = np.where(met, self.depth_m, 1) * slant()
        gain = np.where(met, self.cosine * np.where(self.is_object, 1, albedo) / range_m**2, 0)
        place = range_m / BIN_M + zero_bin
        out = np.empty((len(place), LAST - FIRST, G * G))
        for k in range(LAST - FIRST):
            at = np.rint((FIRST + k - place + 20) / FINE).astype(int)
            out[:, k] = fine[np.clip(at, 0, len(fine) - 1)] * gain
        return out.reshape(-1, G * G)


def non_negative(a: Array, y: Array, steps: int) -> Array:
    """Approximates the x >= 0 that minimises |a x - y|. `steps` is the number of iterations."""
    squares, to = a.T @ a, a.T @ y
    # Finds the largest eigenvalue, which limits the step size, by power iteration.
    v = np.ones(len(to), squares.dtype)
    for _ in range(30):
        v = squares @ v
        v /= max(float(np.linalg.norm(v)), 1e-30)
    step = 1 / max(1.02 * float(v @ squares @ v), 1e-30)
    x = z = np.zeros(len(to), squares.dtype)
    t = 1.0
    for _ in range(steps):
        after = np.maximum(z - step * (squares @ z - to), 0)
        t_after = (1 + np.sqrt(1 + 4 * t * t)) / 2
        z = after + (t - 1) / t_after * (after - x)
        x, t = after, t_after
    return x


def fitted_field(a: Array, counts: Array, steps: int) -> tuple[Array, float]:
    """Fits the field of one zone to counts [poses, bins]. Returns the field [G * G] and the
    fraction of the weighted variance explained by the field."""
    y = counts[:, FIRST:LAST].ravel()
    weight = 1 / np.sqrt(np.maximum(y, 0) + 0.02 * y.max())
    basis = hats()
    x = basis @ non_negative((a @ basis) * weight[:, None], y * weight, steps)
    return x, explained(a, x, counts)


def explained(a: Array, field: Array, counts: Array) -> float:
    """Returns the fraction of the weighted variance explained by a field."""
    y = counts[:, FIRST:LAST].ravel()
    weight = 1 / np.sqrt(np.maximum(y, 0) + 0.02 * y.max())
    return float(1 - (((a @ field - y) * weight)**2).sum() / (((y - y.mean()) * weight)**2).sum())


@dataclass(frozen=True)
class ZoneFit:
    """Fitted parameters of all zones."""

    fields: Array  #: field weights [zones, G * G]
    zero_bin: Array  #: time zeros [zones], bins
    exponent: float  #: exponent of the response
    albedo: float  #: ratio of the table albedo to the object albedo
    explained: Array  #: fraction of the variance explained by the fit [zones]

    def centres(self) -> Array:
        """Returns the mean x, the mean y and the standard deviation of each field [zones, 3], as
        tangents."""
        x, y = (part.ravel() for part in tangents(G, FIELD_TANGENT))
        w = self.fields / self.fields.sum(1, keepdims=True)
        cx, cy = w @ x, w @ y
        return np.stack([cx, cy, np.sqrt((w @ (x**2 + y**2) - cx**2 - cy**2) / 2)], 1)

    def text(self) -> str:
        """Returns a summary with one line per zone."""
        lines = [f"response exponent {self.exponent:g}, table albedo {self.albedo:g} times that of "
                 "the object"]
        for k, (x, y, deviation) in enumerate(self.centres()):
            lines.append(f"zone {k}: centre {x:.3f}, {y:.3f}, standard deviation {deviation:.3f}, "
                         f"time zero at bin {self.zero_bin[k]:.1f}, "
                         f"{self.explained[k]:.3f} of the variance explained")
        return "\n".join(lines)

    def save(self, path: str | pathlib.Path) -> None:
        facts = {key: np.asarray(value).tolist() for key, value in asdict(self).items()}
        pathlib.Path(path).write_text(json.dumps(facts))


def load(path: str | pathlib.Path) -> ZoneFit:
    """Reads a fit written by save(). Raises ValueError if the file is invalid."""
    try:
        facts: dict[str, Any] = json.loads(pathlib.Path(path).read_text())
        fit = ZoneFit(np.array(facts["fields"], float), np.array(facts["zero_bin"], float),
                      float(facts["exponent"]), float(facts["albedo"]),
                      np.array(facts["explained"], float))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: invalid zone fit: {error}") from None
    if fit.fields.shape != (len(fit.zero_bin), G * G):
        raise ValueError(f"{path}: fields has shape {fit.fields.shape} (expected [zones, {G * G}])")
    return fit


def fit_zones(counts: Array, reference: Array, scenes: Scenes) -> ZoneFit:
    """Fits the zones to counts [poses, zones, bins] of a known object. First selects a common time
    zero, exponent and albedo by four-fold cross-validation over the poses. Then fits the time zero
    of each zone."""
    counts = counts - np.median(counts[:, :, -30:], axis=2, keepdims=True)
    zones = counts.shape[1]

    def held_out_share(exponent: float, albedo: float, zero: float) -> float:
        a = scenes.unit_counts(response_of(reference, exponent), zero, albedo)
        by_pose = a.reshape(len(counts), LAST - FIRST, -1)
        shares = []
        for fold in range(4):
            held = np.arange(len(counts)) % 4 == fold
            train, test = (by_pose[rows].reshape(-1, G * G) for rows in (~held, held))
            for k in range(0, zones, max(1, zones // 3)):
                field = fitted_field(train, counts[~held, k], 100)[0]
                shares.append(explained(test, field, counts[held, k]))
        return float(np.mean(shares))

    zero = max(np.arange(11, 13.6, 0.5), key=lambda zero: held_out_share(1.7, 1.2, zero))
    exponent, albedo = max(((e, a) for e in EXPONENTS for a in ALBEDOS),
                           key=lambda pair: held_out_share(pair[0], pair[1], zero))
    response = response_of(reference, exponent)
    best: list[tuple[float, float, Array]] = [(-np.inf, 0.0, np.zeros(0))] * zones
    for own in zero + np.arange(-1.2, 1.3, 0.1):
        a = scenes.unit_counts(response, own, albedo)
        for k in range(zones):
            field, share = fitted_field(a, counts[:, k], 200)
            if share > best[k][0]:
                best[k] = (share, float(own), field)
    fields = np.array([field for _, _, field in best])
    digits = 5 - int(np.floor(np.log10(max(fields.max(), 1e-30))))
    # Rounds the fields, so that the rendered records are identical on all machines.
    return ZoneFit(np.round(fields, digits), np.array([zero for _, zero, _ in best]), exponent,
                   albedo, np.array([share for share, _, _ in best]))
