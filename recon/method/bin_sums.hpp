// SPDX-License-Identifier: MIT
// Sums over bins of a histogram for its centroid, in four sums side by side: each addition to one
// alone waits for the last.
#pragma once
#include <cstddef>
#include <span>

namespace echofuse::recon {

struct BinSums {
  double counts = 0;  // above the background
  double all = 0;     // with it
  double moment = 0;  // sum of counts x bin
};

// What a bin with fewer counts than the background has counts as: nothing, or what it is.
enum class Negative : bool { left_out, counted };

// Of bins [from, to) of both, which are as long.
BinSums bin_sums(std::span<const float> counts, std::span<const float> all, std::size_t from,
                 std::size_t to, Negative negative);

// The same in one plain loop: the reference of the tests, equal to 1e-12.
BinSums plain_bin_sums(std::span<const float> counts, std::span<const float> all, std::size_t from,
                       std::size_t to, Negative negative);

}  // namespace echofuse::recon
