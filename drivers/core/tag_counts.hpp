// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>

namespace echofuse {

// Number of tags in each category. Invariant: tags == starts + in_range + out_of_range +
// without_start + other.
struct TagCounts {
  std::uint64_t tags = 0;
  std::uint64_t starts = 0;
  std::uint64_t in_range = 0;       // clicks counted in the histogram
  std::uint64_t out_of_range = 0;   // clicks after a start, but outside the time axis
  std::uint64_t without_start = 0;  // clicks before the first start
  std::uint64_t other = 0;  // tags on other channels, markers, and tags removed by the dead time
  // The counters below are not part of the invariant.
  std::uint64_t missed = 0;  // start and click events that the device reported as lost
  std::uint64_t overflows = 0;
  std::uint64_t errors = 0;
  std::uint64_t bad_tags = 0;     // unknown type or nonzero reserved byte; included in `other`
  std::uint64_t backwards = 0;    // time tags with an earlier time than the preceding tag
  std::uint64_t removed = 0;      // tags removed by the dead time; included in `other`
  std::uint64_t lost_blocks = 0;  // transport blocks that did not arrive

  TagCounts& operator+=(const TagCounts& more) {
    tags += more.tags;
    starts += more.starts;
    in_range += more.in_range;
    out_of_range += more.out_of_range;
    without_start += more.without_start;
    other += more.other;
    missed += more.missed;
    overflows += more.overflows;
    errors += more.errors;
    bad_tags += more.bad_tags;
    backwards += more.backwards;
    removed += more.removed;
    lost_blocks += more.lost_blocks;
    return *this;
  }
  bool operator==(const TagCounts&) const = default;
};

}  // namespace echofuse
