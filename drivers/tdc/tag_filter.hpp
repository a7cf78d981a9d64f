// SPDX-License-Identifier: MIT
// Delays clicks and applies a dead time before the histogram, for taggers that cannot do this.
//
// Dead time: a tag less than dead_time_ps after the last KEPT tag of its channel is removed
// (non-extending). The start and click channels are treated separately.
//
// Delay: click_delay_ps is added to the times of the click channel. The delay changes the order of
// the tags, so each tag waits until no earlier tag can follow. Before a marker, which reports
// missing time information, all waiting tags are released.
//
// If dead time and delay are both zero, feed() returns its input without a copy.
#pragma once
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "drivers/core/sample.hpp"

namespace echofuse::tdc {

struct FilterSettings {
  std::int32_t start_channel = 1, click_channel = 2;
  std::int64_t click_delay_ps = 0;  // delay added to clicks; may be negative
  std::int64_t dead_time_ps = 0;
};

// Invariant: number of tags fed == tags returned + removed + waiting.
class TagFilter {
 public:
  explicit TagFilter(const FilterSettings& settings);

  // Adds tags. Returns the tags that are ready, sorted by delayed time. The result is valid until
  // the next call.
  std::span<const Tag> feed(std::span<const Tag> tags);
  // Returns all waiting tags. Must be called at the end of a slot, and before a
  // gap in the tags.
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
  std::uint64_t newest_ = 0;  // time of the last tag that was fed, without the click delay
  std::vector<Tag> waiting_, ready_;
  std::uint64_t removed_ = 0;
};

}  // namespace echofuse::tdc
