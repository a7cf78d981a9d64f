// SPDX-License-Identifier: MIT
// Range profile of an FMCW radar (linear chirps) after its matched filter.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/random.hpp"
#include "sim/scene/radar_axis.hpp"

namespace echofuse::sim {

struct Conditions;
struct Returns;

// Computes Psf::at at every point of an axis, for one range after another.
class RangeResponse {
 public:
  explicit RangeResponse(const RadarAxis& axis);
  // Writes the response at each point to an echo at range `cell`, in resolution cells.
  void at(double cell, std::vector<double>& psf) const;

 private:
  Psf psf_;
  double cells_per_point_;
  std::vector<double> cells_, sines_, cosines_;  // one entry per point
};

// Returns the power of receiver noise per antenna sample and frame: radar_snr_db below mean_peak.
double radar_noise_power(const Conditions& c, double mean_peak);

// Returns the rms noise at each point of a profile averaged over `frames` frames. In 60 frames (3 s
// at 20 frames per second) it is radar_snr_db below mean_peak; it falls with the root of their
// number. In one frame the noise is the power of complex Gaussian noise: exponential, its mean
// equal to its rms. The mean of 60 frames and more is treated as Gaussian.
double profile_noise(const Conditions& c, double mean_peak, std::int64_t frames);
// Adds the noise of the mean of `frames` frames, minus its average: powers may be negative.
void add_profile_noise(std::vector<double>& power, double mean_peak, const Conditions& conditions,
                       std::int64_t frames, Rng& rng);
// Adds the noise of one frame.
void add_frame_noise(std::vector<double>& power, double mean_peak, const Conditions& conditions,
                     Rng& rng);

// Returns the linear power of incoherent echoes, sum_k w_k psf^2, without noise. Unit: the mean
// scene as a single point gives 1. antennas.hpp handles coherent echoes.
std::vector<double> radar_power(const Returns& returns, const RadarAxis& axis);

// Returns the peak of the noise-free incoherent profile, averaged over a fixed set of
// base-condition scenes with this axis and baseline. Takes about 50 ms, once per data set.
double mean_peak_power(const RadarAxis& axis, const Conditions& conditions);

}  // namespace echofuse::sim
