// SPDX-License-Identifier: MIT
#include "drivers/core/clock.hpp"

#include <algorithm>
#include <cstdio>
#include <ctime>

namespace echofuse {

namespace {

const SystemClock the_system_clock{};

}  // namespace

const Clock& system_clock = the_system_clock;

HostTime SystemClock::now() const { return std::chrono::steady_clock::now().time_since_epoch(); }

// Uses clock_gettime because std::chrono::system_clock overflows in 2262. Limits the time to the
// year 2260.
UtcTime SystemClock::utc() const {
  using Seconds = std::chrono::seconds;
  constexpr Seconds last =
      std::chrono::floor<Seconds>(UtcTime::max()) - Seconds(std::chrono::years(2));
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  return std::min(Seconds(now.tv_sec), last) + std::chrono::nanoseconds(now.tv_nsec);
}

std::string iso8601(UtcTime time) {
  // floor<seconds> would overflow for the earliest representable times, so the second is computed
  // with integer arithmetic.
  constexpr std::int64_t second = 1'000'000'000;
  const std::int64_t rest = (time.count() % second + second) % second;
  const std::time_t t = time.count() / second - (time.count() % second < 0 ? 1 : 0);
  std::tm tm{};
  gmtime_r(&t, &tm);
  char date[32];
  std::strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &tm);
  char text[48];
  std::snprintf(text, sizeof text, "%s.%03dZ", date, static_cast<int>(rest / 1'000'000));
  return text;
}

}  // namespace echofuse
