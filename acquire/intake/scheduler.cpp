// SPDX-License-Identifier: MIT
#include "acquire/intake/scheduler.hpp"

#include <utility>

namespace echofuse::acquire {
namespace {

constexpr std::chrono::milliseconds longest_pause{100};

}  // namespace

Scheduler::Scheduler(const SlotGrid& grid, std::optional<std::int64_t> count,
                     std::deque<ClosedSlot> recorded)
    : grid_(grid), last_tick_(grid.first), recorded_(std::move(recorded)) {
  if (count) last_ = *count - 1;
}

std::vector<DueSlot> Scheduler::tick(HostTime now) {
  note_pause(now);
  std::vector<DueSlot> due;
  for (; !done() && next_deadline() <= now; ++next_) {
    due.push_back({next_, recorded_.empty() ? stalled(next_) : recorded_.front().stalled});
    if (!recorded_.empty()) recorded_.pop_front();
  }
  return due;
}

// After a pause of the program, delays the closing of the next slot by another grace period. Each
// slot is delayed only once, so that a program that is always late still closes its slots.
void Scheduler::note_pause(HostTime now) {
  const auto pause = now - last_tick_;
  if (pause > longest_pause && held_ != next_) {
    held_ = next_;
    held_until_ = now + grace;
  }
  if (pause > longest_pause + grid_.length) pauses_.push_back({last_tick_, now});
  last_tick_ = now;
  std::erase_if(pauses_, [this](const Pause& p) { return p.until <= grid_.start(next_); });
}

bool Scheduler::stalled(std::int64_t k) const {
  const HostTime start = grid_.start(k);
  return std::any_of(pauses_.begin(), pauses_.end(),
                     [&](const Pause& p) { return p.from <= start && start < p.until; });
}

void Scheduler::finish(HostTime now) {
  const std::int64_t running = std::max(grid_.slot_of(now), next_ - 1);
  last_ = last_ ? std::min(*last_, running) : running;
}

}  // namespace echofuse::acquire
