// SPDX-License-Identifier: MIT
// Conditions under which a run needs the operator's attention. The daemon's hook and the live page
// use the same conditions.
#pragma once
#include <cstdint>
#include <string>

namespace echofuse::record {

// Limits of alerts (keys alert.*), in addition to the limits of the verdicts.
struct AlertLimits {
  double after_s = 0;       // time that a state must last before it is reported; 0: two slots
  double disk_free_gb = 1;  // free disk space below which an alert is sent; 0: no alert

  double lasting_s(double window_s) const { return after_s > 0 ? after_s : 2 * window_s; }
};

// State of one sensor. A new state counts once it has lasted for some time, so that a signal near a
// limit causes one alert, and not one per record.
class LastingState {
 public:
  // Takes the state in a slot, or at a moment (`from_s` == `to_s`). Returns true if the state
  // counts from now on. A problem that turns into another one before it counts keeps its beginning.
  bool take(const std::string& state, double from_s, double to_s, double lasting_s);
  const std::string& state() const { return state_; }

 private:
  std::string state_ = "ok", next_;  // the state that counts; the state that may replace it
  double since_s_ = 0;               // beginning of `next_`
};
bool is_disk_low(std::uint64_t free_bytes, const AlertLimits& limits);

}  // namespace echofuse::record
