// SPDX-License-Identifier: MIT
// Counts tags one at a time, as a reference for tdc::Histogram.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/tdc/histogram.hpp"

namespace echofuse::test {

struct TagReference {
  tdc::HistogramSettings s;
  std::vector<std::uint32_t> counts = std::vector<std::uint32_t>(s.bins);
  TagCounts n{};
  std::uint64_t last_start = 0, last_time = 0;
  bool has_start = false, in_overflow = false;

  // Initialises last_time to the time of the first valid tag, so that this tag never counts as a
  // backward step.
  TagReference(const tdc::HistogramSettings& settings, std::span<const Tag> tags) : s(settings) {
    for (const Tag& tag : tags) {
      if (tag.type != TagType::time_tag || tag.reserved != 0) continue;
      last_time = static_cast<std::uint64_t>(tag.time_ps);
      break;
    }
    for (const Tag& tag : tags) add(tag);
  }
  void add(const Tag& tag) {
    ++n.tags;
    if (tag.type == TagType::time_tag && tag.reserved == 0)
      add_time(tag.channel, static_cast<std::uint64_t>(tag.time_ps));
    else
      add_marker(tag);
  }
  void add_time(std::int32_t channel, std::uint64_t time) {
    n.backwards += static_cast<std::int64_t>(time - last_time) < 0;
    last_time = time;
    if (channel == s.start_channel) {
      ++n.starts;
      last_start = time;
      has_start |= !in_overflow;
    } else if (channel != s.click_channel) {
      ++n.other;
    } else if (!has_start) {
      ++n.without_start;
    } else {
      const std::uint64_t distance = time - last_start - static_cast<std::uint64_t>(s.first_bin_ps);
      const std::uint64_t bin = distance / static_cast<std::uint64_t>(s.bin_width_ps);
      ++(bin < s.bins ? n.in_range : n.out_of_range);
      if (bin < s.bins) ++counts[bin];
    }
  }
  void add_marker(const Tag& tag) {
    ++n.other;
    if (tag.type > TagType::missed_events || tag.reserved != 0) {
      ++n.bad_tags;
      return;
    }
    const bool ours = tag.channel == s.start_channel || tag.channel == s.click_channel;
    if (tag.type == TagType::missed_events) {
      if (ours) n.missed += tag.missed_events;
      return;
    }
    has_start = false;
    if (tag.type != TagType::error) in_overflow = tag.type == TagType::overflow_begin;
    n.overflows += tag.type == TagType::overflow_begin;
    n.errors += tag.type == TagType::error;
  }
};

}  // namespace echofuse::test
