// SPDX-License-Identifier: MIT
#include "acquire/record/alerts.hpp"

namespace echofuse::record {

std::string doubt_kind(bool valid, const Verdict& verdict, double silent_s,
                       const AlertLimits& limits) {
  if (valid) return verdict.row().doubtful ? verdict.word() : "ok";
  return silent_s >= limits.no_data_s ? "no data" : "";
}

bool is_disk_low(std::uint64_t free_bytes, const AlertLimits& limits) {
  return static_cast<double>(free_bytes) < limits.disk_free_gb * 1e9;
}

}  // namespace echofuse::record
