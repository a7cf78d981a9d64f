// SPDX-License-Identifier: MIT
#include "drivers/core/clock.hpp"

#include <cstdio>
#include <ctime>

namespace echofuse {

HostTime SystemClock::now() const { return std::chrono::steady_clock::now().time_since_epoch(); }
UtcTime SystemClock::utc() const { return std::chrono::system_clock::now().time_since_epoch(); }

std::string iso8601(UtcTime time) {
  const auto whole = std::chrono::floor<std::chrono::seconds>(time);
  const std::time_t t = whole.count();
  std::tm tm{};
  gmtime_r(&t, &tm);
  char date[32];
  std::strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &tm);
  char text[48];
  std::snprintf(
      text, sizeof text, "%s.%03dZ", date,
      static_cast<int>(std::chrono::floor<std::chrono::milliseconds>(time - whole).count()));
  return text;
}

}  // namespace echofuse
