// SPDX-License-Identifier: MIT
// Gain and phase of each virtual antenna of the radar, from a reflector straight ahead.
// Pure.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "acquire/config/calibration.hpp"

namespace echofuse::acquire {

struct AntennaFit {
  AntennaGains gains;
  double snr_db = 0;    // power of all antennas over the median bin's
  std::string refusal;  // why there is none; empty: there is one
};

// One frame's samples as RadarFrame::array has them, bins times antennas.
using ArrayFrames = std::vector<std::vector<std::int16_t>>;

// The reflector fills the bin, or one beside it. It stands straight ahead, so its wave reaches all
// antennas alike: the principal eigenvector of their covariance over the frames, at least 8, is
// what the channels add. That needs no agreement of phase between the frames. The standard error
// follows from what is left beside this one wave (of N frames with power P and noise s^2 of an
// antenna s / sqrt(2 N P), and antenna 0's), and from the samples' rounding, which does not average
// out. The wave is taken as flat: at 1 m the board's own width turns the outer antennas by some
// degrees.
AntennaFit fit_antennas(const ArrayFrames& frames, std::size_t antennas, std::size_t bin);
// The errors become what the repeats' scatter says where that is significantly more.
void widen(AntennaGains& all, const std::vector<AntennaGains>& repeats);

// By how many of its standard errors the antenna that differs most does; 0 if one is empty.
double largest_residual(const AntennaGains& a, const AntennaGains& b);

// Text of the fit, a line each.
std::string to_text(const AntennaFit& fit);

}  // namespace echofuse::acquire
