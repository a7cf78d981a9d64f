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

// Samples of some frames, laid out as RadarFrame::array: bins times antennas.
using ArrayFrames = std::vector<std::vector<std::int16_t>>;

// Fits the antennas to a reflector that fills the bin, or one beside it. A reflector straight ahead
// reaches all antennas alike. The principal eigenvector of their covariance over the frames, at
// least 8, is what the channels add. Frames need not agree in phase. Standard error: what is left
// beside this one wave, and the samples' rounding, which does not average out. N frames with power
// P and noise s^2 of an antenna give s / sqrt(2 N P), and antenna 0's. The wave is taken
// as flat: at 1 m the board's own width turns the outer antennas by some degrees.
AntennaFit fit_antennas(const ArrayFrames& frames, std::size_t antennas, std::size_t bin);
// The errors become what the repeats' scatter says where that is significantly more.
void widen(AntennaGains& all, const std::vector<AntennaGains>& repeats);

// Largest difference of an antenna, in its standard errors; 0 if a or b is empty.
double largest_residual(const AntennaGains& a, const AntennaGains& b);

// Text of the fit, a line each.
std::string to_text(const AntennaFit& fit);

}  // namespace echofuse::acquire
