// SPDX-License-Identifier: MIT
// Sums over histogram bins for a centroid. Uses four accumulators, because each addition to a
// single accumulator would wait for the previous addition.
#pragma once
#include <cstddef>
#include <span>

namespace echofuse::recon {

struct BinSums {
  double counts = 0;  // sum of the counts above the background
  double all = 0;     // sum of the counts, including the background
  double moment = 0;  // sum of the bin index times the counts above the background
};

// Selects whether a bin with fewer counts than the background contributes 0 or a negative number.
enum class Negative : bool { left_out, counted };

// Sums the bins [from, to). `counts`: counts above the background; `all`: counts including it. Both
// arrays have the same length.
BinSums bin_sums(std::span<const float> counts, std::span<const float> all, std::size_t from,
                 std::size_t to, Negative negative);

}  // namespace echofuse::recon
