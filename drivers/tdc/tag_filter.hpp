// SPDX-License-Identifier: MIT
// Delays the clicks and applies a dead time before the histogram, for taggers without these
// functions.
//
// Dead time: removes a tag less than dead_time_ps after the last KEPT tag of its channel
// (non-extending). Applies to start and click channel separately.
// Delay: added to the times of the click channel. This changes the order, so tags wait until no
// earlier one can follow. A marker reports missing time information: all waiting tags are released
// before it.
//
// With both zero, feed() returns its input without a copy.
#pragma once
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "drivers/core/sample.hpp"

namespace echofuse::tdc {

struct FilterSettings {
  std::int32_t start_channel = 1, click_channel = 2;
  std::int64_t click_delay_ps = 0;  // may be negative
  std::int64_t dead_time_ps = 0;
};

// tags fed == tags returned + removed + waiting
class TagFilter {
 public:
  explicit TagFilter(const FilterSettings& settings);

  // Adds tags; returns those that are ready, in the order of delayed times. Valid until the next
  // call.
  std::span<const Tag> feed(std::span<const Tag> tags);
  // Returns the waiting tags. Call if tags are missing next, or at the end of a slot.
  std::span<const Tag> flush();
  bool passes_all() const { return pass_through_; }
  // Returns the number of tags removed by the dead time since the last call.
  std::uint64_t take_removed() { return std::exchange(removed_, 0); }

 private:
  struct Channel {
    std::int32_t number = 0;
    std::uint64_t last_kept = 0;
    bool any_kept = false;
  };
  bool keep(Channel& channel, std::uint64_t time);
  void take(Tag tag);
  void sort_waiting();
  void release(std::size_t count);

  Channel start_, click_;
  std::int64_t click_delay_ps_;
  std::uint64_t dead_time_ps_;
  bool pass_through_;
  std::uint64_t newest_ = 0;  // time of the last tag, without delay
  std::vector<Tag> waiting_, ready_;
  std::uint64_t removed_ = 0;
};

}  // namespace echofuse::tdc
