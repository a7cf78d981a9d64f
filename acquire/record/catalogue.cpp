// SPDX-License-Identifier: MIT
#include "acquire/record/catalogue.hpp"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "drivers/core/clock.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::record {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string RunEntry::name() const { return fs::path(path).stem().string(); }
double RunEntry::length_s() const { return seconds(sum.last_utc) - seconds(sum.first_utc); }

RunEntry entry_of(const RunReader& run) {
  RunEntry e{.path = run.path(),
             .info = run.info(),
             .sum = run.summary(),
             .notes = {},
             .leftovers = run.leftovers()};
  if (!e.info.notes.empty()) e.notes.push_back(e.info.notes);
  for (const Event& event : run.events())
    if (event.level == "note") e.notes.push_back(event.text);
  return e;
}

Json to_json(const RunEntry& e) {
  Json valid = Json::object();
  for (const Sensor s : all_sensors) valid[name_of(s)] = e.sum.valid[s];
  Json leftovers = Json::array();
  for (const std::string& file : e.leftovers) leftovers.push_back(utf8_text(file));
  return {{"name", utf8_text(e.name())},
          {"path", utf8_text(e.path)},
          {"started_utc", e.info.started_utc},
          {"length_s", e.length_s()},
          {"records", e.sum.records},
          {"status", e.info.status},
          {"valid", valid},
          {"doubtful", e.sum.verdicts.doubtful},
          {"verdict", e.sum.verdicts.doubts()},
          {"labels", e.sum.labels},
          {"operator", e.info.operator_name},
          {"notes", e.notes},
          {"window_s", e.info.window_s},
          {"leftovers", leftovers}};
}

std::vector<std::string> run_files(const std::string& folder) {
  std::error_code error;
  std::vector<std::string> paths;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::error_code none;
    if (it->path().extension() == ".sqlite" && it->is_regular_file(none))
      paths.push_back(it->path().string());
  }
  if (error) throw Error(ExitCode::failed, printable(folder) + ": " + error.message());
  std::ranges::sort(paths);
  return paths;
}

}  // namespace echofuse::record
