// SPDX-License-Identifier: MIT
// When slots are closed: a pure state machine, (event, now) -> actions. It never asks the time.
//
// Slot k is due at its end plus a grace period, which lets samples that were received in time pass
// through the program's own queues. Whoever calls late gets every slot that became due, in order:
// slots are never skipped. A call more than a whole slot late means that the program itself stood
// still; whatever was read afterwards bears the time of reading, so the slots that began in the gap
// (the one running now included) are marked as stalled.
#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "acquire/slot.hpp"

namespace echofuse::acquire {

struct DueSlot {
  std::int64_t index = 0;
  bool stalled = false;

  bool operator==(const DueSlot&) const = default;
};

class Scheduler {
 public:
  // `count`: slots in the run; none for no end.
  Scheduler(const SlotGrid& grid, std::chrono::nanoseconds grace,
            std::optional<std::int64_t> count = std::nullopt);

  // A quarter of the slot, at most 50 ms.
  static std::chrono::nanoseconds default_grace(std::chrono::nanoseconds slot);

  // The slots to close now.
  std::vector<DueSlot> tick(HostTime now);
  // When tick() has something to do again, while not done().
  HostTime next_deadline() const { return grid_.end(next_) + grace_; }
  // The slot that runs at `now` becomes the last one.
  void finish(HostTime now);
  bool done() const { return last_ && next_ > *last_; }
  std::int64_t closed() const { return next_; }
  const SlotGrid& grid() const { return grid_; }

 private:
  SlotGrid grid_;
  std::chrono::nanoseconds grace_;
  std::int64_t next_ = 0;             // first slot that is not closed
  std::optional<std::int64_t> last_;  // last slot of the run, once known
  HostTime stalled_until_ = HostTime::min();
};

}  // namespace echofuse::acquire
