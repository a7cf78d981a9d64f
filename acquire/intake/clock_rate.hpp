// SPDX-License-Identifier: MIT
#pragma once
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Returns true if `value` differs from `expected` by at most this share of it.
inline bool near(double value, double expected, double share) {
  return std::abs(value - expected) <= share * expected;
}

// Compares the rate of a device clock with that of the host clock, in intervals of at least 2 s.
class ClockRate {
 public:
  // A device time has 64 - `spare_bits` bits, in units of `tick_s`.
  explicit ClockRate(double tick_s, unsigned spare_bits = 0)
      : tick_s_(tick_s), spare_bits_(spare_bits) {}
  // Returns a description if the rates differ by more than 10 %, and by the same factor in two
  // successive intervals: "stands still", or "runs at 1/1000 of the rate of the host clock".
  // Otherwise, returns an empty string.
  std::string add(std::uint64_t ticks, HostTime received);
  void restart() { from_.reset(), before_.reset(); }

 private:
  struct Reading {
    std::uint64_t ticks;
    HostTime received;
  };
  double tick_s_;
  unsigned spare_bits_;
  std::optional<Reading> from_;
  std::optional<double> before_;  // rate in the previous interval
};

}  // namespace echofuse::acquire
