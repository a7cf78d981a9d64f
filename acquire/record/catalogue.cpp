// SPDX-License-Identifier: MIT
#include "acquire/record/catalogue.hpp"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "drivers/core/clock.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string RunEntry::name() const { return fs::path(path).stem().string(); }
double RunEntry::length_s() const { return seconds(sum.last_utc) - seconds(sum.first_utc); }

RunEntry entry_of(const RunReader& run) {
  RunEntry e{.path = run.path(),
             .files = {run.path()},
             .part = {},
             .missing = {},
             .info = run.info(),
             .sum = run.summary(),
             .notes = {}};
  e.part = part_of(e.path, e.info);
  if (!e.info.notes.empty()) e.notes.push_back(e.info.notes);
  for (const Event& event : run.events())
    if (event.level == "note") e.notes.push_back(event.text);
  return e;
}

std::vector<RunEntry> runs_of(std::vector<RunEntry> files) {
  std::vector<RunEntry> out;
  std::vector<std::string> places;  // paths of the whole runs in `out`
  for (RunEntry& e : files) {
    const bool part = e.part.number > 0;
    const std::string whole = part ? whole_and_number(e.path).first : e.path;
    const auto [of_whole, number] = place_of(e.path);
    const std::string place = part || number == 0 ? of_whole : e.path;
    const auto run = out.begin() + (std::ranges::find(places, place) - places.begin());
    const bool begins = run == out.end();
    if (begins || run->part.number == 0 || run->info.uuid != e.info.uuid) {
      if (begins) e.path = whole, e.missing = missing_between(whole, {}, e.part);
      out.push_back(std::move(e));
      places.push_back(place);
      continue;
    }
    if (const std::string gap = missing_between(whole, run->part, e.part); !gap.empty())
      run->missing.append(run->missing.empty() ? "" : "\n") += gap;
    e.info.started_utc = run->info.started_utc;
    run->info = e.info, run->part = e.part;
    run->files.push_back(e.files.front());
    add_part(run->sum, e.sum);
    run->notes.insert(run->notes.end(), e.notes.begin(), e.notes.end());
  }
  return out;
}

Json to_json(const RunEntry& e) {
  Json valid = Json::object();
  for (const Sensor s : all_sensors) valid[name_of(s)] = e.sum.valid[s];
  return {{"name", utf8_text(e.name())},
          {"path", utf8_text(e.path)},
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

Place place_of(const std::string& path) {
  std::error_code error;
  const fs::path place = fs::weakly_canonical(path, error);
  return whole_and_number(error ? path : place.string());
}

std::map<Place, std::string> run_files(const std::string& folder) {
  std::error_code error;
  std::map<Place, std::string> paths;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::error_code none;
    if (it->path().extension() == ".sqlite" && it->is_regular_file(none))
      paths[place_of(it->path().string())] = it->path().string();
  }
  if (error) throw Error(ExitCode::failed, printable(folder) + ": " + error.message());
  return paths;
}

}  // namespace echofuse::record
