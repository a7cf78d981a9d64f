// SPDX-License-Identifier: MIT
#include "acquire/record/run_file.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

RunSummary RunReader::summary() const {
  RunSummary sum;
  Statement totals(
      db_, path_,
      "SELECT count(*), total(valid & 7 = 7), total(valid & 1), total(valid >> 1 & 1), "
      "total(valid >> 2 & 1), total(spd_lost), total(radar_lost), total(depth_lost), total(tags), "
      "ifnull(min(slot_utc_ns), 0), ifnull(max(slot_utc_ns + slot_end_ns - slot_start_ns), 0) "
      "FROM record");
  if (totals.step()) {
    sum.records = totals.integer();
    sum.all_valid = totals.integer();
    for (auto* three : {&sum.valid, &sum.lost})
      for (auto& n : *three) n = totals.integer();
    sum.tags = totals.integer();
    sum.first_utc = UtcTime(totals.integer());
    sum.last_utc = UtcTime(totals.integer());
  }
  const auto count_by = [&](const char* sql, std::map<std::string, std::int64_t>& into) {
    Statement rows(db_, path_, sql);
    while (rows.step()) {
      const std::string name = rows.text();
      into[name] = rows.integer();
    }
  };
  count_by("SELECT label, count(*) FROM record GROUP BY label", sum.labels);
  count_by("SELECT level, count(*) FROM event GROUP BY level", sum.events);
  return sum;
}

}  // namespace echofuse::record
