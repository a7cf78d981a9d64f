// SPDX-License-Identifier: MIT
// Decides when slots are closed. Pure: the caller passes the time.
//
// Slot k is due at its end plus a grace period for late samples: blocks of tags span up to 100 ms
// (500 ms if configured in the bridge) and need transport time.
// If tick() is called late, it returns all due slots in order; it never skips a slot.
//
// tick() must be called every 50 ms. A pause of more than 100 ms means that the program did not
// run. Data that were sent during the pause have not been read yet, so the closing of the next slot
// is delayed by another grace period. After a pause longer than a slot, the slots that began during
// the pause are marked as stalled. Without a clock fit their samples have the time at which they
// were read; with a clock fit a stalled slot is valid if it is complete.
#pragma once
#include <algorithm>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Time axis of a run: slot k covers [first + k*length, first + (k+1)*length) of host time. Slot
// times are absolute, so that late processing causes no drift. Slots of up to 10 s begin at
// multiples of their length. Parallel runs, consecutive runs and programs that move the scene
// therefore use the same slots.
struct SlotGrid {
  HostTime first{};
  std::chrono::nanoseconds length{1};

  HostTime start(std::int64_t k) const { return first + k * length; }
  HostTime end(std::int64_t k) const { return start(k + 1); }
  HostTime centre(std::int64_t k) const { return start(k) + length / 2; }
  // Returns the number of the slot that contains `t`; negative before the run.
  std::int64_t slot_of(HostTime t) const {
    const auto since = t - first;
    const std::int64_t k = since / length;
    return since % length < std::chrono::nanoseconds(0) ? k - 1 : k;
  }
};

// Returns the start of slot 0: the first multiple of `length` that is not before `ready`, or
// `ready` itself if slots are longer than 10 s.
inline HostTime first_slot(HostTime ready, std::chrono::nanoseconds length) {
  constexpr std::chrono::seconds longest_wait{10};
  return length > longest_wait ? ready : (ready + length - HostTime(1)) / length * length;
}

struct DueSlot {
  std::int64_t index = 0;
  bool stalled = false;

  bool operator==(const DueSlot&) const = default;
};

// Slot that a recorded run closed at the time `at`.
struct ClosedSlot {
  HostTime at{};
  bool stalled = false;
};

inline constexpr std::chrono::milliseconds grace{500};

class Scheduler {
 public:
  // `count` is the number of slots of the run; no value: unlimited. The first slots are closed at
  // the times in `recorded`, regardless of their deadlines.
  explicit Scheduler(const SlotGrid& grid, std::optional<std::int64_t> count = std::nullopt,
                     std::deque<ClosedSlot> recorded = {});

  // Returns the slots that must be closed now.
  std::vector<DueSlot> tick(HostTime now);
  // Returns the time at which the next slot becomes due. Undefined if done() is true.
  HostTime next_deadline() const {
    if (!recorded_.empty()) return recorded_.front().at;
    return std::max(grid_.end(next_) + grace, held_until_);
  }
  // Returns by how much slot k is late if it is closed `now`. The additional grace period after a
  // pause counts as lateness.
  std::chrono::nanoseconds lateness(std::int64_t k, HostTime now) const {
    return now - (grid_.end(k) + grace);
  }
  // Makes the slot that contains `now` the last one.
  void finish(HostTime now);
  bool done() const { return last_ && next_ > *last_; }
  std::int64_t closed() const { return next_; }
  const SlotGrid& grid() const { return grid_; }

 private:
  struct Pause {
    HostTime from, until;
  };
  void note_pause(HostTime now);
  bool stalled(std::int64_t k) const;

  SlotGrid grid_;
  std::int64_t next_ = 0;
  std::optional<std::int64_t> last_;  // number of the last slot, if known
  HostTime last_tick_;
  HostTime held_until_ = HostTime::min();
  std::int64_t held_ = -1;  // number of the last slot that got an additional grace period
  // Pauses longer than a slot. Each is kept until all slots that began during it are closed.
  std::vector<Pause> pauses_;
  std::deque<ClosedSlot> recorded_;
};

// Slots that are due but not closed. After a pause of the program, many slots are due at the same
// time. They wait while the disk is busy. If too many later slots also become due, the disk is too
// slow, and all slots are closed without waiting.
class Backlog {
 public:
  // Once this number of slots has become due after a pause, the slots that began during the pause
  // no longer wait for the disk.
  static constexpr std::int64_t max_behind = 128;

  void put(const std::vector<DueSlot>& fresh) {
    due_.insert(due_.end(), fresh.begin(), fresh.end());
    if (fresh.size() > 1) pause_end_ = fresh.back().index;
  }
  // Returns the next slot to close. Returns no value if no slot is due, or if the slot became due
  // during a pause and the disk is `busy`.
  std::optional<DueSlot> next(bool busy) {
    if (due_.empty()) return std::nullopt;
    const bool may_wait =
        due_.front().index <= pause_end_ && due_.back().index - pause_end_ < max_behind;
    if (busy && may_wait) return std::nullopt;
    const DueSlot first = due_.front();
    due_.pop_front();
    return first;
  }
  bool empty() const { return due_.empty(); }

 private:
  std::deque<DueSlot> due_;
  std::int64_t pause_end_ = -1;  // number of the last slot that became due during a pause
};

}  // namespace echofuse::acquire
