// SPDX-License-Identifier: MIT
// Values of TI's range profile (TLV 2), quantity "log2_q8" of a radar axis. A code is 256 * log2 of
// the magnitude, summed over the virtual antennas and divided by the next power of two of their
// number. Source: SDK, DPIF_DETMATRIX_DATA_QFORMAT 8 and the dB conversion of the CFAR threshold.
// The mean over antennas of log2(magnitude) is code / 256 * 2^ceil(log2 n) / n, and
//   power = magnitude^2 = 2^(2 * code / 256 * 2^ceil(log2 n) / n),
// in an arbitrary unit: only ratios are physical. Average frames in power, never in codes.
#pragma once
#include <algorithm>
#include <bit>
#include <cmath>

namespace echofuse {

// Returns log2(power) per code.
inline double log2_power_step(double antennas) {
  const auto n = static_cast<unsigned>(std::max(1.0, antennas));
  return 2.0 / 256.0 * std::bit_ceil(n) / n;
}

inline double power_from_code(double code, double antennas) {
  return std::exp2(code * log2_power_step(antennas));
}

// Inverse conversion; returns 0 for powers below 1, which have no code.
inline double code_from_power(double power, double antennas) {
  return power <= 1 ? 0 : std::log2(power) / log2_power_step(antennas);
}

}  // namespace echofuse
