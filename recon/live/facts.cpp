// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>
#include <sstream>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/live/run_messages.hpp"

namespace echofuse::view {

std::string RunMessages::trigger_levels() const {
  constexpr std::string_view words = "; trigger levels ";
  std::string out;
  try {
    run_.with_reader([&](const record::RunReader& run) {
      for (const DeviceInfo& d : run.devices())
        if (const auto at = d.firmware.find(words);
            d.sensor == Sensor::spd && at != d.firmware.npos)
          out = printable(d.firmware.substr(at + words.size()), 60);
    });
  } catch (const Error&) {  // ignored: other messages report this error
  }
  return out;
}

void for_each_setting(const std::string& resolved,
                      const std::function<void(const std::string&, const std::string&)>& visit) {
  std::istringstream lines(resolved);
  std::string table;
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with("[") && line.ends_with("]"))
      table = line.substr(1, line.size() - 2) + ".";
    else if (const auto equals = line.find(" = "); equals != std::string::npos && line[0] != '#')
      visit(table + line.substr(0, equals), line.substr(equals + 3));
}

// Returns the settings and devices of the run as pairs [name, value].
nlohmann::json RunMessages::facts() const {
  const record::RunInfo& info = run_.info();
  nlohmann::json out = nlohmann::json::array();
  const auto add = [&](const std::string& name, const std::string& text) {
    if (!text.empty()) out.push_back({printable(name), printable(text, 300)});
  };
  add("started", info.started_utc), add("ended", info.ended_utc);
  add("recorded by", "echofuse " + info.version);
  add("notes", info.notes);
  for (const auto& [key, value] : info.meta) add(key, value);
  try {
    run_.with_reader([&](const record::RunReader& run) {
      for (const DeviceInfo& d : run.devices())
        add(name_of(d.sensor), d.model + " " + d.serial + " " + d.firmware + " at " + d.address);
      for (const auto& c : run.calibrations())
        add(name_of(c.sensor) + std::string(", calibrated"),
            format("%+.4f m, %.10s", c.offset_m, c.date_utc.c_str()));
    });
  } catch (const Error&) {  // ignored: other messages report this error
  }
  for_each_setting(info.config_resolved, add);
  return out;
}

}  // namespace echofuse::view
