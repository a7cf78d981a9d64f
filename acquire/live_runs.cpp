// SPDX-License-Identifier: MIT
#include "acquire/live_runs.hpp"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "acquire/lock_file.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/console.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/printable.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

Json sensors_of(const record::RunSummary& sum, const record::RecordOutline& last) {
  Json out = Json::object();
  for (const Sensor s : all_sensors)
    out[name_of(s)] = {{"verdict", last.sync[s].verdict},
                       {"valid", last.valid.contains(s)},
                       {"used", last.sync[s].used},
                       {"lost", sum.lost[s]}};
  return out;
}

// False: it is over by now.
bool read_run(const std::string& path, const Clock& clock, Json& out) {
  const record::RunReader run(path);
  const record::RunInfo info = run.info();
  if (info.status != "open") return false;
  const record::RunSummary sum = run.summary();
  out["records"] = sum.records;
  out["window_s"] = info.window_s;
  if (sum.records == 0) return true;
  const record::RecordOutline last = run.outlines(sum.last_index).at(0);
  out["last_index"] = last.index;
  out["age_s"] = std::max(0.0, seconds(clock.utc() - sum.last_utc));
  out["label"] = last.label;
  out["sensors"] = sensors_of(sum, last);
  return true;
}

Json live_runs(const Clock& clock) {
  std::map<std::string, std::string> who;  // by run
  for (const Holder& holder : holders_in(lock_folder()))
    if (!holder.run.empty()) who[holder.run] = holder.who;
  Json out = Json::array();
  for (const auto& [run, name] : who) {
    Json one{{"run", run},
             {"who", name},
             {"records", 0},
             {"last_index", nullptr},
             {"age_s", nullptr},
             {"window_s", nullptr},
             {"label", ""},
             {"fault", ""},
             {"sensors", Json::object()}};
    try {
      if (!read_run(run, clock, one)) continue;
    } catch (const Error& e) {
      one["fault"] = e.what();
    }
    out.push_back(std::move(one));
  }
  return out;
}

std::string text_of(const Json& run) {
  std::string out = printable(run["run"].get<std::string>()) + ": " +
                    std::to_string(run["records"].get<std::int64_t>()) + " records";
  if (!run["age_s"].is_null())
    out += ", the last one " + human_duration(run["age_s"].get<double>()) + " ago";
  const std::string label = run["label"], fault = run["fault"];
  if (!label.empty()) out += ", label " + printable(label, 40);
  out += "; " + printable(run["who"].get<std::string>()) + "\n";
  if (!fault.empty()) out += "  " + printable(fault) + "\n";
  for (const auto& [name, s] : run["sensors"].items())
    out += "  " + name + std::string(6 - std::min<std::size_t>(name.size(), 5), ' ') +
           printable(s["verdict"].get<std::string>()) + ", " +
           std::to_string(s["used"].get<std::uint64_t>()) +
           (name == "spd" ? " clicks, " : " frames, ") +
           std::to_string(s["lost"].get<std::int64_t>()) + " lost\n";
  return out;
}

}  // namespace

std::string describe_live_runs(const Clock& clock, bool json) {
  const Json runs = live_runs(clock);
  if (json) return runs.dump(2, ' ', true, Json::error_handler_t::replace) + "\n";
  std::string out;
  for (const Json& run : runs) out += text_of(run);
  return out.empty() ? "no run is being recorded on this machine\n" : out;
}

}  // namespace echofuse::acquire
