// SPDX-License-Identifier: MIT
// The time axis of a run: slot k covers [first + k*length, first + (k+1)*length) of host time.
// Absolute, so that nothing drifts however late a slot is handled.
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

}  // namespace echofuse::acquire
