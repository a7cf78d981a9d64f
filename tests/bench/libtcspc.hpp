// SPDX-License-Identifier: MIT
// The histogram of libtcspc, as a peer: every click with every start within the axis before it,
// which is the same where there is one.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/tdc/histogram.hpp"

namespace echofuse::bench {

// Start on channel 1, clicks on channel 2.
std::vector<std::uint32_t> libtcspc_histogram(std::span<const Tag> tags,
                                              const tdc::HistogramSettings& settings);

}  // namespace echofuse::bench
