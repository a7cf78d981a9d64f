// SPDX-License-Identifier: MIT
// Fits the instruments' responses to the reflector, which is a point to both. Pure.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquire/calibrate/peak.hpp"
#include "acquire/measurement/response.hpp"

namespace echofuse::acquire {

// Fits of the two responses; each returns why it sets nothing, or an empty text.

// Fits a Gaussian on an even background to the counts of the search window. A share of the photons
// has an exponential tail; it stays 0 unless it lowers the deviance by 9. Maximum likelihood of
// Poisson counts (Levenberg and Marquardt's steps). Sets irf_fwhm_ps, irf_tail_ps and
// irf_tail_share with their Cramer-Rao errors.
std::string fit_impulse_response(std::span<const std::uint32_t> counts, double start_ps,
                                 double step_ps, const Search& search, record::Response& out);

struct WindowFit {
  Window window{};  // Blackman's if the fit is too bad to place echoes by
  std::string refusal{};
  record::Measured lopsided{};  // far flank less near flank where they differ most, of the power
  double peak_m = 0;            // from the range zero to the peak
  double zero_error_m = 0;
};

// Fits the transform of a window 1 + a cos(2 pi t) + b cos(4 pi t) + ... over the sweep (Harris,
// Proc. IEEE 66, 1978) to the powers about the peak. Least squares; up to six terms, as many as are
// worth 9 in chi2. Terms are the amplitudes at whole cells, so any window has them. A cubic phase
// error must be worth 9, too; it makes the flanks differ, and the taps are then those of the even
// part (record::symmetry_of). Errors are those of ten repeats, and of the firmware's arithmetic; a
// misfit widens them. Bins that another echo reaches stay out: a flank there has more than three
// times the power of the other. Sets the radar's cell, its taps
// and their standard error, unless a bin is off by 5 % of the peak.
WindowFit fit_radar_response(const std::vector<std::vector<std::uint16_t>>& frames,
                             const EchoAxis& axis, double range_m, record::Response& out);

// Fits a line to log(noise of the mean of 1, 2, 4 ... frames) over log(number of frames). Takes the
// weaker half of the bins. Needs at least 40 frames.
std::string fit_noise_exponent(const std::vector<std::vector<std::uint16_t>>& frames,
                               double log2_power_step, record::Response& out);

}  // namespace echofuse::acquire
