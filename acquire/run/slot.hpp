// SPDX-License-Identifier: MIT
// The time axis of a run: slot k covers [first + k*length, first + (k+1)*length) of host time.
// Absolute, so that nothing drifts however late a slot is handled. Slots begin at multiples of
// their length, so that runs beside or after one another have the same ones, and so has who moves
// what is seen.
#pragma once
#include <cstdint>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

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

// When the first slot begins, of a run that can begin at `ready`. One of long slots does not wait.
inline HostTime first_slot(HostTime ready, std::chrono::nanoseconds length) {
  constexpr std::chrono::seconds longest_wait{10};
  return length > longest_wait ? ready : (ready + length - HostTime(1)) / length * length;
}

}  // namespace echofuse::acquire
