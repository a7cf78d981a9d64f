// SPDX-License-Identifier: MIT
// When a run needs its operator: one rule for the daemon's hook and for the live page.
#pragma once
#include <cstdint>
#include <string>

namespace echofuse::record {

// Limits of alerts, besides those of the verdicts (keys alert.*).
struct AlertLimits {
  double no_data_s = 0;     // 0: a sensor is in doubt from its first missing record on
  double disk_free_gb = 1;  // 0: none
};
// Returns "ok" or the kind of the verdict of a valid sensor; of a missing one "no data", or nothing
// if `silent_s`, the time since its last valid slot, is within the limit.
std::string doubt_kind(bool valid, const std::string& verdict, double silent_s,
                       const AlertLimits& limits);
bool is_disk_low(std::uint64_t free_bytes, const AlertLimits& limits);

}  // namespace echofuse::record
