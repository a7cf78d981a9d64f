// SPDX-License-Identifier: MIT
// Slots that are due and not closed yet. After a pause of the program many are due at once; they go
// to the disk as it takes them, as long as that does not last: then it is too slow.
#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "acquire/run/scheduler.hpp"

namespace echofuse::acquire {

class Backlog {
 public:
  static constexpr std::int64_t most_behind = 128;  // slots that wait behind those of a pause

  void put(const std::vector<DueSlot>& fresh) {
    due_.insert(due_.end(), fresh.begin(), fresh.end());
    if (fresh.size() > 1) pause_end_ = fresh.back().index;
  }
  // The slot to close now, in order; none if there is none or, of a pause, the disk is `busy`.
  std::optional<DueSlot> next(bool busy) {
    if (due_.empty()) return std::nullopt;
    const bool may_wait =
        due_.front().index <= pause_end_ && due_.back().index - pause_end_ < most_behind;
    if (busy && may_wait) return std::nullopt;
    const DueSlot first = due_.front();
    due_.pop_front();
    return first;
  }
  bool empty() const { return due_.empty(); }

 private:
  std::deque<DueSlot> due_;
  std::int64_t pause_end_ = -1;  // last of the slots that became due at once
};

}  // namespace echofuse::acquire
