// SPDX-License-Identifier: MIT
#include "drivers/core/clock.hpp"

#include <cstdio>
#include <ctime>

namespace echofuse {

HostTime SystemClock::now() const { return std::chrono::steady_clock::now().time_since_epoch(); }
UtcTime SystemClock::utc() const { return std::chrono::system_clock::now().time_since_epoch(); }

std::string iso8601(UtcTime time) {
  // Not by floor<seconds>, which overflows for the first times that the type holds.
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
