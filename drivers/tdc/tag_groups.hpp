// SPDX-License-Identifier: MIT
// Fast path of the histogram. Processes tags in groups that fill the processor's vectors, with AVX2
// or AVX-512 selected at run time (Google Highway). On other processors the fast path processes no
// tags.
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/core/sample.hpp"

namespace echofuse::tdc {

inline constexpr std::size_t max_group = 8;  // maximum number of tags in a group

// Start and click channels, and the parameters that assign a click to a bin. Times are modulo 2^64.
struct ClickBins {
  std::int32_t start_channel = 0, click_channel = 0;
  std::uint64_t first_bin_ps = 0;
  // at most 2^50, so that rounding never moves a click into another bin
  std::uint64_t range_ps = 0;
  double bins_per_ps = 0;

  // Returns the bin of a click, or the number of bins if the click is out of range. Unsigned
  // arithmetic handles the device clock's wrap and tests both limits in one comparison.
  std::uint32_t bin(std::uint64_t time_ps, std::uint64_t start_ps) const {
    const std::uint64_t distance = std::min(time_ps - start_ps - first_bin_ps, range_ps);
    return static_cast<std::uint32_t>(
        (static_cast<double>(static_cast<std::int64_t>(distance)) + 0.5) * bins_per_ps);
  }
};

// State carried over from tag to tag, and accumulators of one add() call.
struct TagRun {
  std::uint64_t last_start_ps = 0, last_time_ps = 0;
  std::uint64_t starts = 0, others = 0, backwards = 0;
};

// Counts whole groups of tags up to the first group that contains a marker or an invalid tag.
// Returns the number of tags counted. `run.last_start_ps` must be valid. `cells` has one element
// per bin and one for out-of-range clicks.
std::size_t count_groups(const Tag* tags, std::size_t count, const ClickBins& bins, TagRun& run,
                         std::uint32_t* cells);

// Returns true if all are time tags, and none is earlier than its predecessor or than `before_ps`.
bool only_ordered_times(std::span<const Tag> tags, std::uint64_t before_ps);

}  // namespace echofuse::tdc
