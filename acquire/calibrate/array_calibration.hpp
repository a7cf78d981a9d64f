// SPDX-License-Identifier: MIT
// Gain and phase of each virtual antenna of the radar, from a reflector in a known direction.
// Pure.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "acquire/calibrate/reflector.hpp"
#include "acquire/config/calibration.hpp"

namespace echofuse::acquire {

struct AntennaFit {
  AntennaGains gains;
  double snr_db = 0;    // total power / median over the bins
  std::string refusal;  // reason for a rejected fit; empty if accepted
};

// Samples of several frames, in the layout of RadarFrame::array: bins x antennas.
using ArrayFrames = std::vector<std::vector<std::int16_t>>;

// Fits the antenna gains to a reflector in this bin or a neighbouring one: the principal
// eigenvector of the covariance over at least 8 frames. Phases may differ between frames. The
// standard error is s / sqrt(2 N P) for N frames of power P and noise s^2 per antenna, combined
// with that of antenna 0. It includes the residual and the rounding of the samples, which does not
// average out.
AntennaFit fit_antennas(const ArrayFrames& frames, std::size_t antennas, std::size_t bin);
// Subtracts the phases of the reflector's wave, which leaves those of the channels. Adds the errors
// of the reflector's position to the standard errors.
void remove_steering(AntennaGains& gains, const Steering& steering);
// Replaces the errors by the scatter of the repeats where that is significantly larger.
void widen(AntennaGains& all, const std::vector<AntennaGains>& repeats);

// Returns the largest difference between a and b in standard errors; 0 if a or b is empty.
double largest_residual(const AntennaGains& a, const AntennaGains& b);

// Formats the fit, one line per item.
std::string to_text(const AntennaFit& fit);

}  // namespace echofuse::acquire
