// SPDX-License-Identifier: MIT
// Transmitter leakage: the signal that reaches the receiving antennas without an echo. It appears
// at range zero, is often stronger than the echo of a person, and differs between boards. So
// verdicts and record statistics ignore the range bins that may contain it.
#pragma once
#include <algorithm>
#include <cmath>

#include "drivers/core/axis.hpp"

namespace echofuse::record {

// Returns the number of bins at the beginning of a range profile that may contain leakage: those
// nearer than 0.5 m or four steps. Four steps of the default axis are two range cells; beyond them,
// the Blackman window of TI's demos leaves less than 1 % of the peak power.
inline std::size_t leakage_bins(const Axis& axis) {
  const double end_m = std::max(0.5, 4 * axis.step);
  return static_cast<std::size_t>(std::max(0.0, std::ceil((end_m - axis.start) / axis.step)));
}

}  // namespace echofuse::record
