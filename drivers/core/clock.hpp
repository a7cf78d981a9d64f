// SPDX-License-Identifier: MIT
// Clocks and time types. Objects receive their clock from the caller. Code without an event loop
// uses `system_clock`.
#pragma once
#include <chrono>
#include <string>

namespace echofuse {

// Time of CLOCK_MONOTONIC, which starts at boot. Times from before and after a reboot are not
// comparable; anchors stored in the run map them to UTC.
using HostTime = std::chrono::nanoseconds;
// Time in nanoseconds since 1970-01-01T00:00:00Z.
using UtcTime = std::chrono::nanoseconds;

class Clock {
 public:
  virtual ~Clock() = default;
  virtual HostTime now() const = 0;
  virtual UtcTime utc() const = 0;
};

class SystemClock final : public Clock {
 public:
  HostTime now() const override;
  UtcTime utc() const override;
};

extern const Clock& system_clock;

// Formats a time in ISO 8601, for example "2024-02-07T12:34:56.789Z".
std::string iso8601(UtcTime time);

inline double seconds(std::chrono::nanoseconds t) {
  return std::chrono::duration<double>(t).count();
}
inline std::chrono::nanoseconds from_seconds(double s) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(s));
}

}  // namespace echofuse
