// SPDX-License-Identifier: MIT
// Fast path of the histogram: processes tags in groups as wide as the processor's vectors, with
// AVX2 or AVX-512, selected at run time (Google Highway). Other processors process no groups.
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "drivers/core/sample.hpp"

namespace echofuse::tdc {

inline constexpr std::size_t max_group = 8;  // tags

// Both channels, and the bin of a click's time after its start. Times are modulo 2^64.
struct ClickBins {
  std::int32_t start_channel = 0, click_channel = 0;
  std::uint64_t first_bin_ps = 0;
  std::uint64_t range_ps = 0;  // at most 2^50, so that rounding never crosses a bin border
  double bins_per_ps = 0;

  // Unsigned arithmetic handles the wrap of the device's clock and tests both limits in one
  // comparison. Clicks out of range get the bin after the last.
  std::uint32_t bin(std::uint64_t time_ps, std::uint64_t start_ps) const {
    const std::uint64_t distance = std::min(time_ps - start_ps - first_bin_ps, range_ps);
    return static_cast<std::uint32_t>(
        (static_cast<double>(static_cast<std::int64_t>(distance)) + 0.5) * bins_per_ps);
  }
};

// State carried from tag to tag, and accumulators of one add().
struct TagRun {
  std::uint64_t last_start_ps = 0, last_time_ps = 0;
  std::uint64_t starts = 0, others = 0, backwards = 0;
};

// Counts whole groups up to the first group with a marker or an invalid tag. Returns the number of
// counted tags. Requires a known `last_start_ps`. `cells` has size bins + 1.
std::size_t count_groups(const Tag* tags, std::size_t count, const ClickBins& bins, TagRun& run,
                         std::uint32_t* cells);

}  // namespace echofuse::tdc
