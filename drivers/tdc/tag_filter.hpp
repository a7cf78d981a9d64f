// SPDX-License-Identifier: MIT
// A delay of the clicks and a dead time before the histogram, for taggers that have neither.
//
// Dead time: a tag that comes less than dead_time_ps after the last KEPT tag of its channel is
// removed (non-extending). Start and click channel, each by itself.
// Delay: added to the times of the click channel. Tags are then in a new order, so those that a
// later one may still overtake wait. A marker says that time information is missing: what waits
// goes out before it.
//
// With both zero, feed() returns what it is given: no copy.
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

// tags fed == tags returned + removed + tags that wait
class TagFilter {
 public:
  explicit TagFilter(const FilterSettings& settings);

  // Adds tags; returns those that are ready, in the order of delayed times. Valid until the next
  // call.
  std::span<const Tag> feed(std::span<const Tag> tags);
  // Returns the tags that still wait, because tags are missing after them or their slot ends.
  std::span<const Tag> flush();
  bool passes_all() const { return pass_through_; }
  // Tags removed by the dead time since the last call.
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
  std::uint64_t newest_ = 0;  // time of the last tag, before its delay
  std::vector<Tag> waiting_, ready_;
  std::uint64_t removed_ = 0;
};

}  // namespace echofuse::tdc
