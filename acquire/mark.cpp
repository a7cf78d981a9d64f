// SPDX-License-Identifier: MIT
#include "acquire/mark.hpp"

#include <algorithm>

#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/printable.hpp"

namespace echofuse::acquire {
namespace {

// The record of the slot that runs now, counted on from the last one on disk; none if there is none
// since the run began or was resumed.
std::optional<std::int64_t> running_record(const record::RunReader& run, UtcTime now) {
  const record::RunSummary sum = run.summary();
  const double window_s = run.info().window_s;
  if (sum.records == 0 || !(window_s > 0)) return std::nullopt;
  const std::string last = iso8601(sum.last_utc);
  for (const record::Event& e : run.events())
    if (e.source == "run" && e.text.starts_with("resumed") && e.utc > last) return std::nullopt;
  const double since = seconds(now - sum.last_utc) / window_s;
  return sum.records + static_cast<std::int64_t>(std::clamp(since, 0.0, 1e15));
}

}  // namespace

std::string mark_run(const std::string& path, const std::optional<std::string>& remark,
                     const std::optional<std::string>& label) {
  record::mark(path, label ? "label" : "mark", label ? *label : *remark);
  const auto record = running_record(record::RunReader(path), SystemClock().utc());
  const std::string number = record ? "record " + std::to_string(*record) : "the running record";
  const std::string what = label ? "label \"" + *label + "\" from " + number + " on"
                                 : "\"" + *remark + "\" noted in " + number;
  return printable(path) + ": " + printable(what);
}

}  // namespace echofuse::acquire
