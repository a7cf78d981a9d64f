// SPDX-License-Identifier: MIT
// Fits the responses of the SPD and the radar to the reflector, which is a point target for both
// sensors. Pure functions.
#pragma once
#include <cstdint>
#include <span>
#include <string>

#include "acquire/calibrate/peak.hpp"
#include "acquire/measurement/response.hpp"

namespace echofuse::acquire {

// Each fit function returns an empty string on success. If the fit fails, the function sets nothing
// and returns the reason.

// Fits a Gaussian on a constant background to the Poisson counts in the search window, by maximum
// likelihood (Levenberg-Marquardt). Adds an exponential tail for a fraction of the photons if the
// tail reduces the deviance by more than 9. Sets `irf_fwhm_ps`, `irf_tail_ps` and `irf_tail_share`
// and their Cramer-Rao standard errors.
std::string fit_impulse_response(std::span<const std::uint32_t> counts, double start_ps,
                                 double step_ps, const Search& search, record::Response& out);

struct WindowFit {
  Window window{};  // fitted window; a Blackman window if the fit is rejected
  std::string refusal{};
  // Largest difference in power between the far and the near flank of the peak, relative to the
  // peak.
  record::Measured lopsided{};
  double zero_error_m = 0;
};

// Fits the transform of a window 1 + a cos(2 pi t) + b cos(4 pi t) + ... over the sweep (Harris,
// Proc. IEEE 66, 1978) to the powers around the peak, by least squares. The terms a, b, ... are the
// amplitudes at whole cells. Up to six terms are used; each further term must reduce chi2 by more
// than 9. A cubic phase error, which makes the flanks unequal, is added if it reduces chi2 by more
// than 9 times chi2 per degree of freedom (at least 0.5, at most 1). The taps then describe both
// flanks. Range zero is the peak.
// Standard errors are derived from the scatter of the frames and the precision of the firmware's
// arithmetic, and are increased if the fit is poor. Bins in which one flank has more than three
// times the power of the other flank are excluded, because they contain another echo. Sets the
// radar's cell and taps and the standard error of the taps, unless transmitter leakage overlaps the
// echo, or the fit deviates from the measured power of any bin by more than 5 % of the peak.
WindowFit fit_radar_response(const Profiles& frames, const EchoAxis& axis, double range_m,
                             record::Response& out);

// Determines how the noise decreases when frames are averaged, for the weaker half of the bins.
// Averages 1, 2, 4, ... frames and fits a line to log(noise) as a function of log(number of
// frames). Needs at least 40 frames.
std::string fit_noise_exponent(const Profiles& frames, record::Response& out);

}  // namespace echofuse::acquire
