// SPDX-License-Identifier: MIT
#include "acquire/record/alerts.hpp"

namespace echofuse::record {

bool LastingState::take(const std::string& state, double from_s, double to_s, double lasting_s) {
  constexpr double rounding_s = 1e-6;
  if (state == state_) return next_.clear(), false;
  const bool goes_on = !next_.empty() && (next_ == "ok") == (state == "ok");
  if (!goes_on) since_s_ = from_s;
  next_ = state;
  if (to_s - since_s_ < lasting_s - rounding_s) return false;
  state_ = state, next_.clear();
  return true;
}

bool is_disk_low(std::uint64_t free_bytes, const AlertLimits& limits) {
  return static_cast<double>(free_bytes) < limits.disk_free_gb * 1e9;
}

}  // namespace echofuse::record
