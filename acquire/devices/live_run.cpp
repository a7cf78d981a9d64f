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

LiveDevice last_record(const std::string& file, Sensor sensor, const Clock& clock) {
  const record::RunReader reader(file);
  const std::string status = reader.info().status;
  if (status != "open") return {"its run is " + status};
  const std::int64_t last = reader.summary().last_index;
  if (last < 0) return {"its run has no record yet"};
  const record::FusedRecord r = reader.read(last);
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
  const std::string file = record::files_of(holder.run).paths.back();
  if (std::filesystem::is_regular_file(file, none)) {
    try {
      found = last_record(file, sensor, clock);
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
