// SPDX-License-Identifier: MIT
// Estimates the centre and the width of the highest peak of a histogram or range profile.
#pragma once
#include <optional>
#include <span>

#include "drivers/core/axis.hpp"

namespace echofuse::view {

// Result of a peak fit. Positions and widths are in the units of the axis.
struct PeakFit {
  double centre = 0, centre_error = 0;  // centre and its standard error
  double fwhm = 0;
  double height = 0;  // height above the background
};

// Fits a Gaussian on a constant background to the highest peak in [from, to], by least squares
// (Levenberg-Marquardt). If `counts` is true, uses Poisson weights and corrects the FWHM for the
// bin width (Sheppard). Returns an empty value if the height is below five standard errors.
std::optional<PeakFit> fit_peak(std::span<const double> values, const Axis& axis, double from,
                                double to, bool counts);

// Returns the number of bins before the first return, minus a margin of 3. The return begins where
// the sum of five neighbouring bins significantly exceeds the mean of all previous bins. Returns
// the total number of bins if no return is found, and 0 if 10 or fewer bins would remain.
std::size_t bins_before_return(std::span<const double> counts);

}  // namespace echofuse::view
