// SPDX-License-Identifier: MIT
// What fog, smoke and rain do to light of 1550 nm and to a radar of 60 GHz. Single scattering: in a
// room, paths are short against the mean free path until nothing is seen any more.
//
// Fog: drops of a gamma distribution n(r) ~ r^alpha exp(-b r), of the class that is usual at a
// visibility (Shettle and Fenn, AFGL-TR-79-0214, 1979: heavy and moderate advection fog, heavy and
// moderate radiation fog), as many as make it: extinction at 550 nm = 3.912 / visibility
// (Koschmieder, contrast 2 %), efficiency of a drop by van de Hulst (1957), section 11.22.
// Rain: 1.076 R^0.67 dB/km of light (Carbonneau and Wisely, Proc. SPIE 3232, 1998); gamma = k R^a
// of the radar (ITU-R P.838-3). Fog at 60 GHz: ITU-R P.840-8.
#pragma once
#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

struct DropClass {
  double alpha, b_per_um;  // of the gamma distribution of radii
};
DropClass fog_class(double visibility_m);

// Mean extinction efficiency of these drops, weighted by their cross sections.
double extinction_efficiency(const DropClass& drops, double wavelength_um, double refractive_index);
// Of drops of density 1 with an extinction (1/m) at 550 nm: g/m^3.
double liquid_water_g_m3(const DropClass& drops, double extinction_550_per_m);

double rain_extinction_per_m(double rain_mm_h);  // of light, any of its colours
double rain_attenuation_db_km(double rain_mm_h, double frequency_ghz);  // one way; mean of H and V
// dB/km of one g/m^3, one way.
double water_attenuation(double frequency_ghz, double temperature_k);

struct Weather {
  double extinction_per_m = 0;        // of the laser's light
  double backscatter_per_m_sr = 0;    // of the laser's light
  double radar_attenuation_db_m = 0;  // one way
  bool clear() const { return extinction_per_m <= 0; }
};
// Extinction over backscatter (lidar ratio): drops 18.8 sr (O'Connor et al., J. Atmos. Oceanic
// Technol. 21, 777, 2004), smoke 60 sr (Mueller et al., J. Geophys. Res. 112, D16202, 2007).
Weather weather_of(const Conditions& conditions);

}  // namespace echofuse::sim
