// SPDX-License-Identifier: MIT
// Histogram computed by libtcspc, for comparison with that of echofuse. libtcspc counts each click
// once for every earlier start within the range of the histogram. The two histograms are equal if
// each click has only one such start.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/tdc/histogram.hpp"

namespace echofuse::bench {

// Counts the clicks of channel 2 after the starts of channel 1, with libtcspc.
std::vector<std::uint32_t> libtcspc_histogram(std::span<const Tag> tags,
                                              const tdc::HistogramSettings& settings);

}  // namespace echofuse::bench
