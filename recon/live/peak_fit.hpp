// SPDX-License-Identifier: MIT
// Centre and width of the highest peak of a histogram or range profile.
#pragma once
#include <optional>
#include <span>

#include "drivers/core/axis.hpp"

namespace echofuse::view {

// Lengths in units of the axis.
struct PeakFit {
  double centre = 0, centre_error = 0;  // standard error
  double fwhm = 0;
  double height = 0;  // above the background
};

// Fits a Gaussian on a constant background around the highest value of [from, to] by least squares
// (Levenberg-Marquardt). `counts`: with Poisson weights, and the FWHM is corrected for the bin
// width (Sheppard). Empty if the height is below five standard errors.
std::optional<PeakFit> fit_peak(std::span<const double> values, const Axis& axis, double from,
                                double to, bool counts);

// Returns the number of bins before the first return, less a margin of 3. A return begins where
// five neighbouring bins significantly exceed the mean of all bins before them. Without a return:
// all bins. 0 if 10 or fewer bins would remain.
std::size_t bins_before_return(std::span<const double> counts);

}  // namespace echofuse::view
