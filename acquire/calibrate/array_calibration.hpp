// SPDX-License-Identifier: MIT
// Measures the gain and the phase of each virtual antenna of the radar with a reflector in a known
// direction. Pure functions.
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
  double snr_db = 0;    // ratio of the power in the reflector's bin to the median power of all bins
  std::string refusal;  // reason why the fit was rejected; empty if it was accepted
};

// Antenna samples of several frames. Each frame is laid out as in RadarFrame::array: bins x
// antennas.
using ArrayFrames = std::vector<std::vector<std::int16_t>>;

// Fits the gain and the phase of each antenna to the echo of a reflector in `bin` or a neighbouring
// bin. The result is the principal eigenvector of the covariance matrix of at least 8 frames, so
// the phase of the echo may differ between frames. The standard error of an antenna's phase and
// relative gain is s / sqrt(2 N P), combined with that of antenna 0. N is the number of frames and
// P the echo power at the antenna. The residual of the fit gives the noise power s^2 of an
// antenna. The rounding error of the samples is added to the standard errors, because it does
// not average out.
AntennaFit fit_antennas(const ArrayFrames& frames, std::size_t antennas, std::size_t bin);
// Removes the phases caused by the reflector's direction, so that only the phases of the antenna
// channels remain. Adds the uncertainty of the reflector position to the standard errors.
void remove_steering(AntennaGains& gains, const Steering& steering);
// Replaces an antenna's standard error with the value derived from the repeats if that value is
// significantly larger.
void widen(AntennaGains& all, const std::vector<AntennaGains>& repeats);

// Returns the largest difference between `a` and `b`, in units of its standard error; 0 if `a` or
// `b` is empty.
double largest_residual(const AntennaGains& a, const AntennaGains& b);

// Formats the fit as text, with one line per antenna.
std::string to_text(const AntennaFit& fit);

}  // namespace echofuse::acquire
