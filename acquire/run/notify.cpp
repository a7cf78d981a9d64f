// SPDX-License-Identifier: MIT
#include "acquire/run/notify.hpp"

#include <systemd/sd-daemon.h>

#include <cinttypes>

namespace echofuse::acquire {

void notify_ready(double window_s) {
  constexpr double slots = 4, us_per_s = 1e6;
  const double timeout_us = slots * window_s * us_per_s;
  std::uint64_t limit_us = 0;
  if (sd_watchdog_enabled(0, &limit_us) > 0 && static_cast<double>(limit_us) < timeout_us)
    sd_notifyf(0, "WATCHDOG_USEC=%" PRIu64, static_cast<std::uint64_t>(timeout_us));
  sd_notify(0, "READY=1\nSTATUS=0 records on disk");
}

void notify_advance(std::int64_t records) {
  sd_notifyf(0, "WATCHDOG=1\nSTATUS=%" PRId64 " records on disk", records);
}

void notify_stopping() { sd_notify(0, "STOPPING=1"); }

}  // namespace echofuse::acquire
