// SPDX-License-Identifier: MIT
// Conditions under which a run needs the operator's attention. The daemon's hook and the live page
// use the same conditions.
#pragma once
#include <cstdint>
#include <string>

#include "acquire/measurement/verdict.hpp"

namespace echofuse::record {

// Limits of alerts (keys alert.*), in addition to the limits of the verdicts.
struct AlertLimits {
  double no_data_s = 0;     // time without data before an alert; 0: at the first missing record
  double disk_free_gb = 1;  // free disk space below which an alert is sent; 0: no alert
};
// Returns the kind of problem for the alert. For a valid sensor, this is the kind of its verdict,
// which is "ok" if the data are good. For a missing sensor, it is "no data" if `silent_s`, the time
// since its last valid slot, has reached the limit; otherwise it is empty.
std::string doubt_kind(bool valid, const Verdict& verdict, double silent_s,
                       const AlertLimits& limits);
bool is_disk_low(std::uint64_t free_bytes, const AlertLimits& limits);

}  // namespace echofuse::record
