# SPDX-License-Identifier: MIT
"""Adds fog to simulated histograms. Fog attenuates the signal and scatters light back.

The droplet radii have a gamma distribution, n(r) ~ r^alpha exp(-b r). Its parameters depend on the
visibility (Shettle and Fenn, AFGL-TR-79-0214, 1979). The extinction at 550 nm is 3.912 / visibility
(Koschmieder, contrast 2 %). The extinction efficiency follows van de Hulst (1957), section 11.22.
The lidar ratio is taken from O'Connor et al., J. Atmos. Oceanic Technol. 21, 777 (2004). The model
neglects multiple scattering, shadows in the fog, the broadening of the backscatter by the impulse
response, and the attenuation of the radar signal (1 %)."""
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runs.run import PS_PER_M

__all__ = ["add_fog", "extinction_per_m"]

LASER_UM, VISIBLE_UM = 1.55, 0.55
REFRACTIVE_INDEX = {LASER_UM: 1.318, VISIBLE_UM: 1.333}
LIDAR_RATIO_SR = 18.8
# albedo cos(theta) dOmega / R^2, summed over the mean scene (sim/sensors/render.hpp), 1/m^2
MEAN_SCENE_WEIGHT = 0.24 / 3.5**4


def extinction_per_m(visibility_m: float) -> float:
    """Returns the extinction coefficient at the laser wavelength, 1/m."""
    classes = ((180, 3, 0.3), (235, 3, 0.375), (350, 6, 1.5), (np.inf, 6, 3))
    alpha, b = next((alpha, b) for limit_m, alpha, b in classes if visibility_m < limit_m)
    radius_um = (alpha + 3) / b * np.arange(1, 4000) / 400
    weight = radius_um ** (alpha + 2) * np.exp(-b * radius_um)

    def mean_efficiency(wavelength_um: float) -> float:
        rho = 4 * np.pi * radius_um / wavelength_um * (REFRACTIVE_INDEX[wavelength_um] - 1)
        efficiency = 2 - 4 / rho * np.sin(rho) + 4 / rho**2 * (1 - np.cos(rho))
        return float(weight @ efficiency / weight.sum())

    return 3.912 / visibility_m * mean_efficiency(LASER_UM) / mean_efficiency(VISIBLE_UM)


def add_fog(clear: NDArray[np.uint32], visibility_m: float, settings: dict[str, Any],
            seed: int) -> NDArray[np.uint32]:
    """Returns the counts [n, bins] in fog, with background and pile-up. `clear` contains the counts
    in clear air, without background and pile-up. `settings` contains the simulator settings,
    {key: value}."""
    rng, bins, step_ps = np.random.default_rng(seed), clear.shape[1], settings["bin_width_ps"]
    start_ps = settings["first_bin_ps"] - settings["spd_delay_ps"]
    range_m = (start_ps + (np.arange(bins) + 0.5) * step_ps) / PS_PER_M
    extinction = extinction_per_m(visibility_m)
    transmission = np.exp(-2 * extinction * np.maximum(range_m, 0))
    edge, cells = settings["half_tangent"] * settings["spd_field"], 32
    tangent2 = np.add.outer(*2 * [(edge * (np.arange(cells) + 0.5) / cells) ** 2])
    falloff = np.exp(-settings["spd_falloff"] * tangent2 / edge**2)
    solid_angle_sr = 4 * (edge / cells) ** 2 * np.sum((1 + tangent2) ** -1.5 * falloff)
    # A Lambertian surface returns the power albedo cos(theta) / (pi R^2) per unit solid angle.
    # A fog layer of thickness dR returns beta dR / R^2, where beta is the backscatter coefficient.
    back = np.pi * extinction / LIDAR_RATIO_SR * solid_angle_sr / MEAN_SCENE_WEIGHT
    near = (range_m > 1) & (range_m < 15)
    rate = np.where(near, back * transmission / range_m**2, 0) * step_ps / PS_PER_M
    rate = settings["signal_photons"] * rate + settings["background_counts"] / bins
    counts = rng.binomial(clear, transmission) + rng.poisson(rate, clear.shape)
    if (pulses := settings["pulses_per_window"]) > 0:
        counts = np.array([first_photons(row, pulses, rng) for row in counts])
    return counts.astype(np.uint32)


def first_photons(counts: NDArray[Any], pulses: int, rng: np.random.Generator) -> NDArray[Any]:
    """Returns the counts [bins] of a detector that registers only the first photon per pulse."""
    bins = np.repeat(np.arange(counts.size), counts)
    first = np.unique(rng.integers(pulses, size=bins.size), return_index=True)[1]
    return np.bincount(bins[first], minlength=counts.size)
