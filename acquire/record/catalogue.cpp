// SPDX-License-Identifier: MIT
#include "acquire/record/catalogue.hpp"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "acquire/record/run_parts.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string RunEntry::name() const { return fs::path(path).stem().string(); }
double RunEntry::length_s() const { return seconds(sum.last_utc) - seconds(sum.first_utc); }

RunEntry entry_of(const RunReader& run) {
  RunEntry e{.path = run.path(), .info = run.info(), .sum = run.summary(), .notes = {}};
  if (!e.info.notes.empty()) e.notes.push_back(e.info.notes);
  for (const Event& event : run.events())
    if (event.level == "note") e.notes.push_back(event.text);
  return e;
}

bool join_part(RunEntry& entry, const RunEntry& next) {
  const std::string whole = whole_of(next.path);
  const auto is_part = [&](const RunEntry& e) {  // a copy under another name is a run by itself
    return e.path == part_path(whole, part_of(e.info).number) || e.path == whole;
  };
  if (entry.info.uuid != next.info.uuid || !is_part(entry) || !is_part(next) || next.path == whole)
    return false;
  const std::string started = entry.info.started_utc;
  entry.path = whole;
  entry.info = next.info;
  entry.info.started_utc = started;
  add_part(entry.sum, next.sum);
  entry.notes.insert(entry.notes.end(), next.notes.begin(), next.notes.end());
  return true;
}

Json to_json(const RunEntry& e) {
  Json valid = Json::object();
  for (const Sensor s : all_sensors) valid[name_of(s)] = e.sum.valid[s];
  return {{"name", e.name()},
          {"path", e.path},
          {"started_utc", e.info.started_utc},
          {"length_s", e.length_s()},
          {"records", e.sum.records},
          {"status", e.info.status},
          {"valid", valid},
          {"doubtful", e.sum.doubtful},
          {"verdict", doubts_of(e.sum)},
          {"labels", e.sum.labels},
          {"operator", e.info.operator_name},
          {"notes", e.notes},
          {"window_s", e.info.window_s}};
}

std::string place_of(const std::string& path) {
  std::error_code error;
  const fs::path place = fs::weakly_canonical(path, error);
  return error ? path : place.string();
}

std::map<std::string, std::string> run_files(const std::string& folder) {
  std::error_code error;
  std::map<std::string, std::string> paths;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::error_code none;
    if (it->path().extension() == ".sqlite" && it->is_regular_file(none))
      paths[place_of(it->path().string())] = it->path().string();
  }
  if (error) throw Error(ExitCode::failed, printable(folder) + ": " + error.message());
  return paths;
}

}  // namespace echofuse::record
