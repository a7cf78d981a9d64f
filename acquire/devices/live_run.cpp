// SPDX-License-Identifier: MIT
#include "acquire/devices/live_run.hpp"

#include <chrono>
#include <filesystem>

#include "acquire/record/run_parts.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

LiveDevice told_of(const record::FusedRecord& r, Sensor sensor, const Clock& clock) {
  const auto& sync = r.sync[sensor];
  const double age_s = std::chrono::duration<double>(clock.utc() - r.slot_utc).count() -
                       seconds(r.slot_end - r.slot_start);
  return {"record " + std::to_string(r.index) + ", " + human_duration(std::max(age_s, 0.0)) +
              " ago: " + sync.verdict + ", " + std::to_string(sync.used) +
              (sensor == Sensor::spd ? " clicks" : " frames") + " used, " +
              std::to_string(sync.lost) + " lost",
          r.has(sensor)};
}

// The last part of a run may have no record yet.
LiveDevice last_record(const std::vector<std::string>& files, Sensor sensor, const Clock& clock) {
  for (auto file = files.rbegin(); file != files.rend(); ++file) {
    const record::RunReader run(*file);
    const std::string status = run.info().status;
    if (file == files.rbegin() && status != "open") return {"its run is " + status};
    const std::int64_t last = run.summary().last_index;
    if (last >= 0) return told_of(run.read(last), sensor, clock);
  }
  return {"its run has no record yet"};
}

}  // namespace

LiveDevice inspect_holder(const Holder& holder, Sensor sensor, const Clock& clock) {
  LiveDevice found;
  std::error_code none;
  const auto files = record::files_of(holder.run).paths;
  if (std::filesystem::is_regular_file(files.back(), none)) {
    try {
      found = last_record(files, sensor, clock);
    } catch (const Error& e) {
      found.text = e.what();
    }
  } else if (!holder.run.empty()) {
    found.text = "its run file is not there yet";
  }
  found.text = "in use by " + holder.who + (found.text.empty() ? "" : "; ") + printable(found.text);
  return found;
}

}  // namespace echofuse::acquire
