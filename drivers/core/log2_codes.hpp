// SPDX-License-Identifier: MIT
// Codes of TI's range profile (TLV 2), stored with the quantity "log2_q8" of a radar axis. A code
// is the sum of 256 * log2(magnitude) over the virtual antennas, divided by their number rounded up
// to a power of two. Source: SDK, DPIF_DETMATRIX_DATA_QFORMAT 8 and the dB conversion of the CFAR
// threshold. The mean of log2(magnitude) over n antennas is code / 256 * 2^ceil(log2 n) / n, so
//   power = magnitude^2 = 2^(2 * code / 256 * 2^ceil(log2 n) / n).
// The unit of power is arbitrary: only ratios are physical. To average frames, average
// their powers, not their codes.
#pragma once
#include <algorithm>
#include <bit>
#include <cmath>

namespace echofuse {

// Returns the increase in log2(power) when the code increases by 1.
inline double log2_power_step(double antennas) {
  const auto n = static_cast<unsigned>(std::max(1.0, antennas));
  return 2.0 / 256.0 * std::bit_ceil(n) / n;
}

inline double power_from_code(double code, double antennas) {
  return std::exp2(code * log2_power_step(antennas));
}

// Inverse of power_from_code(). Returns code 0 for powers below 1, because codes are not negative.
inline double code_from_power(double power, double antennas) {
  return power <= 1 ? 0 : std::log2(power) / log2_power_step(antennas);
}

}  // namespace echofuse
