// SPDX-License-Identifier: MIT
// State machine that closes slots: (event, now) -> actions. Pure: never asks the time.
//
// Slot k is due at its end plus a grace, which lets samples that were taken in time come in: blocks
// of tags are up to 100 ms long (500 ms if the bridge is told so), and have their way to go.
// A late caller gets every slot that became due, in order: slots are never skipped.
//
// tick() wants to be called every 50 ms. A pause of more than 100 ms means that the program stood
// still. What was sent meanwhile waits to be read, so the slot to be closed next gets another
// grace. After a pause of more than a slot, those that began in it are marked as stalled: without a
// fitted clock, samples bear the time at which they were read. With one, a slot that is whole is
// valid all the same.
#pragma once
#include <algorithm>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Time axis of a run: slot k covers [first + k*length, first + (k+1)*length) of host time.
// Absolute, so that nothing drifts however late a slot is handled. Slots begin at multiples of
// their length. Runs beside or after one another, and whoever moves what is seen, so have the same
// slots.
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

// Start of slot 0 of a run that can begin at `ready`. A run of long slots does not wait.
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
  // `count`: slots in the run; none for no end.
  explicit Scheduler(const SlotGrid& grid, std::optional<std::int64_t> count = std::nullopt);

  // The slots to close now.
  std::vector<DueSlot> tick(HostTime now);
  // Time at which tick() has something to do again, while not done().
  HostTime next_deadline() const { return std::max(grid_.end(next_) + grace, held_until_); }
  // Lateness of slot k if it is closed `now`; a second grace is late, too.
  std::chrono::nanoseconds lateness(std::int64_t k, HostTime now) const {
    return now - (grid_.end(k) + grace);
  }
  // The slot that runs at `now` becomes the last one.
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
  std::int64_t next_ = 0;             // first slot that is not closed
  std::optional<std::int64_t> last_;  // last slot of the run, once known
  HostTime last_tick_;
  HostTime held_until_ = HostTime::min();
  std::int64_t held_ = -1;     // the slot that had its second grace
  std::vector<Pause> pauses_;  // pauses longer than a slot, in which open slots began
};

// Slots that are due and not closed yet. After a pause of the program many are due at once; they go
// to the disk as it takes them, as long as that does not last: then it is too slow.
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
