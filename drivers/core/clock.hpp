// SPDX-License-Identifier: MIT
// Clocks and the time of samples. Clocks are injected; code without a loop receives `system_clock`.
#pragma once
#include <chrono>
#include <string>

namespace echofuse {

// CLOCK_MONOTONIC since boot. Not comparable across a reboot; anchors in the run map it to UTC.
using HostTime = std::chrono::nanoseconds;
// Nanoseconds since 1970-01-01T00:00:00Z.
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

// Clock that a test advances.
class ManualClock final : public Clock {
 public:
  HostTime now() const override { return now_; }
  UtcTime utc() const override { return utc_offset_ + now_; }
  void advance(std::chrono::nanoseconds by) { now_ += by; }
  void set(HostTime now) { now_ = now; }

 private:
  HostTime now_{0};
  UtcTime utc_offset_{0};
};

// "2024-02-07T12:34:56.789Z" (ISO 8601)
std::string iso8601(UtcTime time);

inline double seconds(std::chrono::nanoseconds t) {
  return std::chrono::duration<double>(t).count();
}
inline std::chrono::nanoseconds from_seconds(double s) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(s));
}

}  // namespace echofuse
