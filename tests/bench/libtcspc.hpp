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

// Uses libtcspc to compute the histogram of the delays between starts on channel 1 and clicks on
// channel 2.
std::vector<std::uint32_t> libtcspc_histogram(std::span<const Tag> tags,
                                              const tdc::HistogramSettings& settings);

}  // namespace echofuse::bench
