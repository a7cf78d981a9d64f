// SPDX-License-Identifier: MIT
// The histogram's fast path: time tags in groups as wide as the processor's vectors, with AVX2 or
// AVX-512, chosen at run time (Google Highway). On other processors a group is never taken.
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "drivers/core/sample.hpp"

namespace echofuse::tdc {

inline constexpr std::size_t max_group = 8;  // tags

// The two channels, and where a click's distance from its start falls. Times are modulo 2^64.
struct ClickBins {
  std::int32_t start_channel = 0, click_channel = 0;
  std::uint64_t first_bin_ps = 0;
  std::uint64_t range_ps = 0;  // at most 2^50, so that no step below rounds across a bin border
  double bins_per_ps = 0;

  // Unsigned: right across the wrap of the device's clock, and one compare for both ends. What is
  // out of range is in the bin behind the last.
  std::uint32_t bin(std::uint64_t time_ps, std::uint64_t start_ps) const {
    const std::uint64_t distance = std::min(time_ps - start_ps - first_bin_ps, range_ps);
    return static_cast<std::uint32_t>(
        (static_cast<double>(static_cast<std::int64_t>(distance)) + 0.5) * bins_per_ps);
  }
};

// From tag to tag, and sums.
struct TagRun {
  std::uint64_t last_start_ps = 0, last_time_ps = 0;
  std::uint64_t starts = 0, others = 0, backwards = 0;
};

// Counts the tags in front of the first group with a marker or a bad tag, in whole groups, and says
// how many they were. A start before them must be known. `cells` has one more cell than bins.
std::size_t count_groups(const Tag* tags, std::size_t count, const ClickBins& bins, TagRun& run,
                         std::uint32_t* cells);

}  // namespace echofuse::tdc
