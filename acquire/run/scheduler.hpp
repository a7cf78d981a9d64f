// SPDX-License-Identifier: MIT
// When slots are closed: a pure state machine, (event, now) -> actions. It never asks the time.
//
// Slot k is due at its end plus a grace, which lets samples that were taken in time come in: blocks
// of tags are up to 100 ms long (500 ms if the bridge is told so), and have their way to go.
// Whoever calls late gets every slot that became due, in order: slots are never skipped.
//
// tick() wants to be called every 50 ms. A pause of more than 100 ms means that the program stood
// still. What was sent meanwhile waits to be read, so the slot to be closed next gets another
// grace. After a pause of more than a slot, those that began in it are marked as stalled: without a
// fitted clock, samples bear the time at which they were read. With one, a slot that is whole is
// valid all the same.
#pragma once
#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "acquire/run/slot.hpp"

namespace echofuse::acquire {

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
  // When tick() has something to do again, while not done().
  HostTime next_deadline() const { return std::max(grid_.end(next_) + grace, held_until_); }
  // By how much slot k is late if it is closed `now`; a second grace is late, too.
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
  std::vector<Pause> pauses_;  // of more than a slot, that open slots began in
};

}  // namespace echofuse::acquire
