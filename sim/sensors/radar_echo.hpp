// SPDX-License-Identifier: MIT
// The range profile of a linear-frequency-modulated radar after its matched filter.
#pragma once
#include <vector>

#include "drivers/core/random.hpp"
#include "sim/scene/radar_axis.hpp"

namespace echofuse::sim {

struct Conditions;
struct Returns;

// Amplitude, 1 at u = 0: sin(pi u)/(pi u), or the transform of a Blackman window (-3 dB width 1.64,
// side lobes below -58 dB; Harris, Proc. IEEE 66, 1978). u in resolution cells.
double psf_amplitude(Psf psf, double u);

// psf_amplitude at every point of an axis, for echoes from one range after the other.
class RangeResponse {
 public:
  explicit RangeResponse(const RadarAxis& axis);
  // Of an echo so many cells away, at each point.
  void at(double cell, std::vector<double>& psf) const;

 private:
  Psf psf_;
  double cells_per_point_;
  std::vector<double> cells_, sines_, cosines_;  // of each point
};

// Power of the receiver's noise in each point.
double radar_noise_power(const Conditions& c, double mean_peak);

// Linear power of echoes that do not interfere, sum_k w_k psf^2, without noise; in units in which
// the mean scene as a single point would give 1. What interferes is of antennas.hpp.
std::vector<double> radar_power(const Returns& returns, const RadarAxis& axis);

// Peak of the noise-free incoherent profile, averaged over a fixed set of base-condition scenes
// as seen with this axis and baseline. Takes some 50 ms: once per data set.
double mean_peak_power(const RadarAxis& axis, const Conditions& conditions);

// White Gaussian noise on the power profile, sigma = 10^(-radar_snr_db/10) * mean_peak. Noisy
// values may be negative.
void add_radar_noise(std::vector<double>& power, double mean_peak, const Conditions& conditions,
                     Rng& rng);

}  // namespace echofuse::sim
