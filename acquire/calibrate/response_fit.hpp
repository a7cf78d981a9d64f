// SPDX-License-Identifier: MIT
// Fits the sensors' responses to the reflector, a point target for both. Pure.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquire/calibrate/peak.hpp"
#include "acquire/measurement/response.hpp"

namespace echofuse::acquire {

// Each fit returns the reason why it sets nothing, or an empty text.

// Fits a Gaussian on a constant background to the Poisson counts of the search window, by maximum
// likelihood (Levenberg-Marquardt). Part of the photons has an exponential tail if that reduces the
// deviance by 9. Sets irf_fwhm_ps, irf_tail_ps and irf_tail_share with Cramer-Rao errors.
std::string fit_impulse_response(std::span<const std::uint32_t> counts, double start_ps,
                                 double step_ps, const Search& search, record::Response& out);

struct WindowFit {
  Window window{};  // Blackman window if the fit is rejected
  std::string refusal{};
  record::Measured lopsided{};  // largest difference, far - near flank, relative to the peak
  double peak_m = 0;            // from the range zero to the peak
  double zero_error_m = 0;
};

// Fits the transform of a window 1 + a cos(2 pi t) + b cos(4 pi t) + ... over the sweep (Harris,
// Proc. IEEE 66, 1978) to the powers around the peak, by least squares. Terms are the amplitudes at
// whole cells; up to six are used if each reduces chi2 by 9. A cubic phase error, which makes the
// flanks differ, must also reduce it by 9; the taps are then those of the even part
// (record::symmetry_of). Errors are from ten repeats and the firmware's arithmetic, increased for a
// bad fit. Bins with another echo are excluded: one flank has more than three times the power of
// the other. Sets the radar's cell, taps and their standard error, unless the fit differs from a
// bin by 5 % of the peak.
WindowFit fit_radar_response(const std::vector<std::vector<std::uint16_t>>& frames,
                             const EchoAxis& axis, double range_m, record::Response& out);

// Fits a line to log(noise of the mean of 1, 2, 4 ... frames) over log(number of frames), for the
// weaker half of the bins. Needs at least 40 frames.
std::string fit_noise_exponent(const std::vector<std::vector<std::uint16_t>>& frames,
                               double log2_power_step, record::Response& out);

}  // namespace echofuse::acquire
