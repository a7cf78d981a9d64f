// SPDX-License-Identifier: MIT
// Histogram by libtcspc, as a peer. It counts every click with every earlier start within the axis,
// which is equal if there is only one.
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
