// SPDX-License-Identifier: MIT
// Sums over bins of a histogram for its centroid: four side by side, because each addition to a
// single sum waits for the last.
#pragma once
#include <cstddef>
#include <span>

namespace echofuse::recon {

struct BinSums {
  double counts = 0;  // above the background
  double all = 0;     // with it
  double moment = 0;  // sum of counts x bin
};

// Treatment of a bin with fewer counts than the background: as 0, or as it is.
enum class Negative : bool { left_out, counted };

// Adds up the bins [from, to) of both arrays, which have the same length.
BinSums bin_sums(std::span<const float> counts, std::span<const float> all, std::size_t from,
                 std::size_t to, Negative negative);

}  // namespace echofuse::recon
