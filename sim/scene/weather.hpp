// SPDX-License-Identifier: MIT
// Fog, smoke and rain act on light of 1550 nm and on a radar of 60 GHz. Scattering is single: in a
// room, paths are short against the mean free path until nothing is seen any more.
//
// Fog has drops of a gamma distribution n(r) ~ r^alpha exp(-b r), of the class that is usual at a
// visibility (Shettle and Fenn, AFGL-TR-79-0214, 1979: heavy and moderate advection fog, heavy and
// moderate radiation fog). As many drops are there as make the visibility: extinction at 550 nm =
// 3.912 / visibility (Koschmieder, contrast 2 %). The efficiency of a drop is by van de Hulst
// (1957), section 11.22.
// Rain takes 1.076 R^0.67 dB/km of light (Carbonneau and Wisely, Proc. SPIE 3232, 1998), and gamma
// = k R^a of the radar (ITU-R P.838-3). Fog at 60 GHz follows ITU-R P.840-8.
#pragma once
#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

struct DropClass {
  double alpha, b_per_um;  // parameters of the gamma distribution of radii
};
DropClass fog_class(double visibility_m);

// Mean extinction efficiency of these drops, weighted by their cross sections.
double extinction_efficiency(const DropClass& drops, double wavelength_um, double refractive_index);
// Liquid water, in g/m^3, of drops of density 1 with this extinction (1/m) at 550 nm.
double liquid_water_g_m3(const DropClass& drops, double extinction_550_per_m);

double rain_extinction_per_m(double rain_mm_h);                         // light of any colour
double rain_attenuation_db_km(double rain_mm_h, double frequency_ghz);  // one way; mean of H and V
// Attenuation in dB/km of one g/m^3, one way.
double water_attenuation(double frequency_ghz, double temperature_k);

struct Weather {
  double extinction_per_m = 0;        // for the laser's light
  double backscatter_per_m_sr = 0;    // for the laser's light
  double radar_attenuation_db_m = 0;  // one way
  bool clear() const { return extinction_per_m <= 0; }
};
// The extinction over backscatter (lidar ratio) is 18.8 sr for drops (O'Connor et al., J. Atmos.
// Oceanic Technol. 21, 777, 2004), and 60 sr for smoke (Mueller et al., J. Geophys. Res. 112,
// D16202, 2007).
Weather weather_of(const Conditions& conditions);

}  // namespace echofuse::sim
