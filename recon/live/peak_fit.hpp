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

// Least-squares fit of a Gaussian on an even background, about the highest value of [from, to]
// (Levenberg-Marquardt). Counts have Poisson weights, and the width of a bin is taken out of theirs
// (Sheppard). Empty if the height is below five of its standard errors.
std::optional<PeakFit> fit_peak(std::span<const double> values, const Axis& axis, double from,
                                double to, bool counts);

// Number of bins before the first return: the first five neighbours that exceed the mean of all
// bins before them by more than chance. All bins if nothing does; 0 with fewer than 10 before it.
std::size_t bins_before_return(std::span<const double> counts);

}  // namespace echofuse::view
