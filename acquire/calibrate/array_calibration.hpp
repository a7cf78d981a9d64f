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
  double snr_db = 0;    // power of all antennas over the median bin's
  std::string refusal;  // why there is none; empty: there is one
};

// Samples of some frames, laid out as RadarFrame::array: bins times antennas.
using ArrayFrames = std::vector<std::vector<std::int16_t>>;

// Fits the antennas to a reflector that fills the bin or a neighbouring one. The fit is the
// principal eigenvector of their covariance over at least 8 frames, whose phases may differ. The
// standard error contains the residual of this one wave and the samples' rounding, which does not
// average out: N frames with power P and noise s^2 of an antenna give s / sqrt(2 N P), combined
// with that of antenna 0.
AntennaFit fit_antennas(const ArrayFrames& frames, std::size_t antennas, std::size_t bin);
// Subtracts the phases of the reflector's wave; the rest is what the channels add. The errors of
// its place join the standard errors.
void remove_steering(AntennaGains& gains, const Steering& steering);
// The errors become what the repeats' scatter says where that is significantly more.
void widen(AntennaGains& all, const std::vector<AntennaGains>& repeats);

// Largest difference of an antenna, in its standard errors; 0 if a or b is empty.
double largest_residual(const AntennaGains& a, const AntennaGains& b);

// Text of the fit, a line each.
std::string to_text(const AntennaFit& fit);

}  // namespace echofuse::acquire
