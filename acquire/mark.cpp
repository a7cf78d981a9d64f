// SPDX-License-Identifier: MIT
#include "acquire/mark.hpp"

#include <algorithm>

#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/printable.hpp"

namespace echofuse::acquire {
namespace {

// The record of the slot that runs now; none if the slots on disk do not tell, as none has been
// closed since the run began or went on.
std::optional<std::int64_t> running_record(const record::RunReader& run, UtcTime now) {
  constexpr std::int64_t usual_slots_behind = 2;  // those closed, and waiting for the disk
  const record::RunSummary sum = run.summary();
  const auto window = from_seconds(run.info().window_s);
  if (sum.records == 0 || window.count() <= 0) return std::nullopt;
  const std::int64_t behind = std::max(HostTime(0), now - sum.last_utc) / window;
  if (behind > usual_slots_behind) return std::nullopt;
  return sum.records + behind;
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
