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

// The last part of a run may have no record yet.
LiveDevice last_record(std::vector<std::string> files, Sensor sensor, const Clock& clock) {
  const std::string status = record::RunReader(files.back()).info().status;
  if (status != "open") return {"its run is " + status};
  const auto last_of = [&] { return record::RunReader(files.back()).summary().last_index; };
  while (files.size() > 1 && last_of() < 0) files.pop_back();
  const std::int64_t last = last_of();
  if (last < 0) return {"its run has no record yet"};
  const record::FusedRecord r = record::RunReader(files.back()).read(last);
  const auto& sync = r.sync[sensor];
  const double age_s = std::chrono::duration<double>(clock.utc() - r.slot_utc).count() -
                       seconds(r.slot_end - r.slot_start);
  return {"record " + std::to_string(r.index) + ", " + human_duration(std::max(age_s, 0.0)) +
              " ago: " + sync.verdict + ", " + std::to_string(sync.used) +
              (sensor == Sensor::spd ? " clicks" : " frames") + " used, " +
              std::to_string(sync.lost) + " lost",
          r.has(sensor)};
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
