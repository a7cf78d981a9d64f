// SPDX-License-Identifier: MIT
// Simulates the range profile of an FMCW radar (linear chirps) after its matched filter.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/random.hpp"
#include "sim/scene/radar_axis.hpp"

namespace echofuse::sim {

struct Conditions;
struct Returns;

// Computes the response Psf::at() at all points of an axis, for echoes at different ranges.
class RangeResponse {
 public:
  explicit RangeResponse(const RadarAxis& axis);
  // For each point of the axis, writes the response to an echo at the range `cell`, in resolution
  // cells.
  void at(double cell, std::vector<double>& psf) const;

 private:
  Psf psf_;
  double cells_per_point_;
  // Ranges of the points in resolution cells, and the sines and cosines of pi times these ranges.
  std::vector<double> cells_, sines_, cosines_;
};

// Returns the power of the receiver noise in a sample of one antenna and frame. The noise power is
// `radar_snr_db` dB below `mean_peak`.
double radar_noise_power(const Conditions& c, double mean_peak);

// Returns the rms noise at each point of a profile averaged over `frames` frames. For 60 frames (3
// s at 20 frames per second) the noise is `radar_snr_db` dB below `mean_peak`. The noise is
// proportional to 1 / sqrt(frames). In a single frame the noise is the power of complex Gaussian
// noise: its distribution is exponential, and its mean equals its rms. A mean of 60 or more frames
// is treated as Gaussian.
double profile_noise(const Conditions& c, double mean_peak, std::int64_t frames);
// Adds the noise of a profile averaged over `frames` frames, less the expected value of the noise.
// Powers may therefore be negative.
void add_profile_noise(std::vector<double>& power, double mean_peak, const Conditions& conditions,
                       std::int64_t frames, Rng& rng);
void add_frame_noise(std::vector<double>& power, double mean_peak, const Conditions& conditions,
                     Rng& rng);

// Returns the noise-free power of incoherent echoes at each point: sum_k w_k psf^2. The weights are
// scaled so that the mean scene, as a single point, has power 1. antennas.hpp simulates coherent
// echoes.
std::vector<double> radar_power(const Returns& returns, const RadarAxis& axis);

// Returns the peak power of a noise-free incoherent profile with this axis and baseline, averaged
// over a fixed set of scenes under the default conditions. Takes about 50 ms; call it once per data
// set.
double mean_peak_power(const RadarAxis& axis, const Conditions& conditions);

}  // namespace echofuse::sim
