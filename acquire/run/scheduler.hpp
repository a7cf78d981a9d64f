// SPDX-License-Identifier: MIT
// State machine that closes slots: (event, now) -> actions. Pure: does not read a clock.
//
// Slot k is due at its end plus a grace period for late samples: blocks of tags span up to 100 ms
// (500 ms if configured in the bridge) and need transport time.
// A late caller gets every due slot, in order: no slot is skipped.
//
// tick() must be called every 50 ms. A pause of more than 100 ms means that the program did not
// run. Data sent in between are still to be read, so the next slot gets a second grace period.
// After a pause of more than a slot, the slots that began in it are marked as stalled: without a
// fitted clock their samples have the time of reading. With one, a complete slot is valid.
#pragma once
#include <algorithm>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Time axis of a run: slot k covers [first + k*length, first + (k+1)*length) of host time.
// Absolute, so that late handling causes no drift. Slots begin at multiples of their length, so
// parallel and consecutive runs, and programs that move the scene, share the same slots.
struct SlotGrid {
  HostTime first{};
  std::chrono::nanoseconds length{1};

  HostTime start(std::int64_t k) const { return first + k * length; }
  HostTime end(std::int64_t k) const { return start(k + 1); }
  HostTime centre(std::int64_t k) const { return start(k) + length / 2; }
  // Negative before the run.
  std::int64_t slot_of(HostTime t) const {
    const auto since = t - first;
    const std::int64_t k = since / length;
    return since % length < std::chrono::nanoseconds(0) ? k - 1 : k;
  }
};

// Returns the start of slot 0 of a run that can begin at `ready`. Runs with long slots begin at
// once.
inline HostTime first_slot(HostTime ready, std::chrono::nanoseconds length) {
  constexpr std::chrono::seconds longest_wait{10};
  return length > longest_wait ? ready : (ready + length - HostTime(1)) / length * length;
}

struct DueSlot {
  std::int64_t index = 0;
  bool stalled = false;

  bool operator==(const DueSlot&) const = default;
};

inline constexpr std::chrono::milliseconds grace{500};

class Scheduler {
 public:
  // `count`: number of slots; no value: unlimited.
  explicit Scheduler(const SlotGrid& grid, std::optional<std::int64_t> count = std::nullopt);

  // Returns the slots to close now.
  std::vector<DueSlot> tick(HostTime now);
  // Returns the time at which tick() has work again, while not done().
  HostTime next_deadline() const { return std::max(grid_.end(next_) + grace, held_until_); }
  // Returns the delay of slot k if it is closed `now`; includes a second grace period.
  std::chrono::nanoseconds lateness(std::int64_t k, HostTime now) const {
    return now - (grid_.end(k) + grace);
  }
  // Makes the slot at `now` the last one.
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
  std::int64_t next_ = 0;             // first open slot
  std::optional<std::int64_t> last_;  // last slot of the run, if known
  HostTime last_tick_;
  HostTime held_until_ = HostTime::min();
  std::int64_t held_ = -1;     // slot that had its second grace period
  std::vector<Pause> pauses_;  // pauses longer than a slot in which open slots began
};

// Slots that are due but not closed. After a pause many are due at once; they wait for the disk,
// within a limit beyond which the disk is too slow.
class Backlog {
 public:
  static constexpr std::int64_t most_behind = 128;  // later slots that may wait behind those of a
                                                    // pause

  void put(const std::vector<DueSlot>& fresh) {
    due_.insert(due_.end(), fresh.begin(), fresh.end());
    if (fresh.size() > 1) pause_end_ = fresh.back().index;
  }
  // Returns the next slot to close; nothing without one, or if it is from a pause and the disk
  // is `busy`.
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
  std::int64_t pause_end_ = -1;  // last slot that became due together with others
};

}  // namespace echofuse::acquire
