// SPDX-License-Identifier: MIT
#include "acquire/record/annotate.hpp"

#include <algorithm>

#include "acquire/commands/commands.hpp"
#include "acquire/record/run_reader.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::acquire {
namespace {

// Returns the index of the current slot's record, extrapolated from the last record on disk; no
// value if the index is unknown.
std::optional<std::int64_t> running_record(const record::RunReader& run, UtcTime now) {
  const record::RunSummary sum = run.summary();
  const double window_s = run.info().window_s;
  if (sum.records == 0 || !(window_s > 0)) return std::nullopt;
  const double since = seconds(now - sum.last_utc) / window_s;
  return sum.last_index + 1 + static_cast<std::int64_t>(std::clamp(since, 0.0, 1e15));
}

}  // namespace

std::string annotate_run(const std::string& path, const std::optional<std::string>& note,
                         const std::optional<std::string>& label) {
  if (label)
    record::put_label(path, *label, login_name());
  else
    record::put_note(path, *note, login_name());
  const record::RunReader run(path);
  const auto record = running_record(run, system_clock.utc());
  const std::string number = record ? "record " + std::to_string(*record) : "the current record";
  const std::string where = run.info().status == "open" ? " in " + number : "";
  const std::string what =
      label ? "label \"" + *label + "\" from " + number + " on" : "\"" + *note + "\" noted" + where;
  return printable(path) + ": " + printable(what);
}

}  // namespace echofuse::acquire
