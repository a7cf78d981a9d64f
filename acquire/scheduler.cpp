// SPDX-License-Identifier: MIT
#include "acquire/scheduler.hpp"

#include <algorithm>

namespace echofuse::acquire {

Scheduler::Scheduler(const SlotGrid& grid, std::chrono::nanoseconds grace,
                     std::optional<std::int64_t> count)
    : grid_(grid), grace_(grace) {
  if (count) last_ = *count - 1;
}

std::chrono::nanoseconds Scheduler::default_grace(std::chrono::nanoseconds slot) {
  return std::min<std::chrono::nanoseconds>(slot / 4, std::chrono::milliseconds(50));
}

std::vector<DueSlot> Scheduler::tick(HostTime now) {
  std::vector<DueSlot> due;
  const bool stood_still = now - next_deadline() > grid_.length;
  while (!done() && next_deadline() <= now) {
    due.push_back({next_, grid_.start(next_) < stalled_until_});
    ++next_;
    if (stood_still) stalled_until_ = now;  // from here on: the first due slot had its time
  }
  return due;
}

void Scheduler::finish(HostTime now) {
  const std::int64_t running = std::max(grid_.slot_of(now), next_ - 1);
  last_ = last_ ? std::min(*last_, running) : running;
}

}  // namespace echofuse::acquire
