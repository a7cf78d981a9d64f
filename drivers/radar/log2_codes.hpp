// SPDX-License-Identifier: MIT
// Codes of TI's range profile (TLV 2). A code is the sum of 256 * log2(magnitude) over the virtual
// antennas, divided by their number rounded up to a power of two. Source: SDK,
// DPIF_DETMATRIX_DATA_QFORMAT 8 and the dB conversion of the CFAR threshold. The mean of
// log2(magnitude) over n antennas is code / 256 * 2^ceil(log2 n) / n, so
//   power = magnitude^2 = 2^(2 * code / 256 * 2^ceil(log2 n) / n).
// The unit of power is arbitrary: only ratios are physical. To average frames, average
// their powers, not their codes.
#pragma once
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace echofuse::radar {

// Returns the power of a code. The firmware sends no code above 2^13; a damaged one gives at most
// 2^127, so that every power is a finite float. `antennas` is at least 1.
inline float power_from_code(std::uint16_t code, std::uint32_t antennas) {
  const double step = 2.0 / 256.0 * std::bit_ceil(antennas) / antennas;
  return static_cast<float>(std::exp2(std::min(code * step, 127.0)));
}

}  // namespace echofuse::radar
