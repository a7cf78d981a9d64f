// SPDX-License-Identifier: MIT
#include "acquire/commands/catalogue.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "acquire/devices/lock_file.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Entry {
  std::string path;
  record::RunInfo info;
  record::RunSummary sum;
  std::vector<std::string> notes;
  Json live;  // null: it is not

  std::string name() const { return fs::path(path).stem().string(); }
  double length_s() const { return seconds(sum.last_utc) - seconds(sum.first_utc); }
};

using Holders = std::map<std::string, std::string>;  // who writes it, by the run's path

Holders holders() {
  Holders out;
  for (const Holder& holder : holders_in(lock_folder()))
    if (!holder.run.empty()) out[holder.run] = holder.who;
  return out;
}

Json live_state(const record::RunReader& run, const record::RunSummary& sum, const std::string& who,
                const Clock& clock) {
  Json out{{"who", who}, {"last_index", nullptr}, {"age_s", nullptr}, {"label", ""}};
  out["sensors"] = Json::object();
  if (sum.records == 0) return out;
  const record::RecordOutline last = run.outlines(sum.last_index).at(0);
  out["last_index"] = last.index;
  out["age_s"] = std::max(0.0, seconds(clock.utc() - sum.last_utc));
  out["label"] = last.label;
  for (const Sensor s : all_sensors)
    out["sensors"][name_of(s)] = {{"verdict", last.sync[s].verdict},
                                  {"valid", last.valid.contains(s)},
                                  {"used", last.sync[s].used},
                                  {"lost", sum.lost[s]}};
  return out;
}

Entry read_entry(const std::string& path, const std::string& who, const Clock& clock) {
  const record::RunReader run(path);
  Entry e{.path = path, .info = run.info(), .sum = run.summary(), .notes = {}, .live = {}};
  if (e.info.status == "open") e.live = live_state(run, e.sum, who, clock);
  if (!e.info.notes.empty()) e.notes.push_back(e.info.notes);
  for (const record::Event& event : run.events())
    if (event.level == "note") e.notes.push_back(event.text);
  return e;
}

// Without "." and links in it, as in the lock of who writes it.
std::string place_of(const fs::path& path) {
  std::error_code error;
  const fs::path place = fs::weakly_canonical(path, error);
  return error ? path.string() : place.string();
}

// The path by place.
std::map<std::string, std::string> run_files(const std::string& folder) {
  std::error_code error;
  std::map<std::string, std::string> paths;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".sqlite" && entry.is_regular_file(error))
      paths[place_of(entry.path())] = entry.path().string();
  if (error) throw Error(ExitCode::failed, printable(folder) + ": " + error.message());
  return paths;
}

Json to_json(const Entry& e) {
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
          {"verdict", record::doubts_of(e.sum)},
          {"labels", e.sum.labels},
          {"operator", e.info.operator_name},
          {"notes", e.notes},
          {"window_s", e.info.window_s},
          {"live", e.live}};
}

std::string percent(std::int64_t part, std::int64_t whole) {
  const auto share = 100.0 * static_cast<double>(part) / static_cast<double>(whole);
  return whole > 0 ? std::to_string(std::lround(std::floor(share))) : "-";
}

constexpr std::size_t columns = 10;
using Row = std::array<std::string, columns>;
const Row titles{"run",   "started (UTC)", "length",   "records", "valid %",
                 "state", "labels",        "operator", "notes",   "verdict"};

Row row_of(const Entry& e) {
  constexpr std::size_t longest = 40;  // of a text; --json holds all
  const auto short_text = [](const std::string& text) { return printable(text, longest); };
  std::string labels, notes;
  for (const auto& [label, count] : e.sum.labels)
    if (!label.empty()) labels.append(labels.empty() ? "" : ", ") += label;
  for (const auto& note : e.notes) notes.append(notes.empty() ? "" : "; ") += note;
  std::string valid;
  for (const Sensor s : all_sensors)
    valid.append(valid.empty() ? "" : " ") += percent(e.sum.valid[s], e.sum.records);
  return {short_text(e.name()),
          short_text(e.info.started_utc.substr(0, 16)),
          human_duration(std::max(0.0, e.length_s())),
          std::to_string(e.sum.records),
          valid,
          e.live.is_null() ? short_text(e.info.status) : "live",
          short_text(labels),
          short_text(e.info.operator_name),
          short_text(notes),
          printable(record::doubts_of(e.sum), 2 * longest)};
}

std::string table_of(const std::vector<Row>& rows) {
  std::array<std::size_t, columns> widths{};
  for (const Row& row : rows)
    for (std::size_t c = 0; c < columns; ++c) widths[c] = std::max(widths[c], row[c].size());
  std::string out;
  for (const Row& row : rows) {
    std::string line;
    for (std::size_t c = 0; c < columns; ++c)
      line += row[c] + std::string(widths[c] - row[c].size() + 2, ' ');
    line.erase(line.find_last_not_of(' ') + 1);
    out += line + "\n";
  }
  return out;
}

std::string live_text(const Entry& e) {
  std::string out = "\n";
  out += printable(e.path) + " is live";
  if (!e.live["age_s"].is_null())
    out += ", its last record " + human_duration(e.live["age_s"].get<double>()) + " old";
  if (const std::string who = e.live["who"]; !who.empty()) out.append("; ") += printable(who);
  out += "\n";
  for (const auto& [name, s] : e.live["sensors"].items())
    out += "  " + name + std::string(6 - std::min<std::size_t>(name.size(), 5), ' ') +
           printable(s["verdict"].get<std::string>()) + ", " +
           std::to_string(s["used"].get<std::uint64_t>()) +
           (name == "spd" ? " clicks, " : " frames, ") +
           std::to_string(s["lost"].get<std::int64_t>()) + " lost\n";
  return out;
}

}  // namespace

Catalogue list_runs(const std::string& folder, bool elsewhere, const Clock& clock, bool json) {
  Catalogue out;
  Holders who;
  auto paths = run_files(folder);
  for (const auto& [run, holder] : holders()) {
    who[place_of(run)] = holder;
    if (elsewhere) paths.try_emplace(place_of(run), run);
  }
  std::vector<Entry> entries;
  for (const auto& [place, path] : paths) {
    try {
      entries.push_back(read_entry(path, who[place], clock));
    } catch (const Error& e) {
      out.left_out.append(out.left_out.empty() ? "" : "\n") += e.what();
      if (!who[place].empty()) out.left_out.append("; ") += printable(who[place]);
    }
  }
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return a.info.started_utc < b.info.started_utc;
  });
  if (json) {
    Json all = Json::array();
    for (const Entry& e : entries) all.push_back(to_json(e));
    out.text = all.dump(2, ' ', true, Json::error_handler_t::replace) + "\n";
    return out;
  }
  std::vector<Row> rows{titles};
  for (const Entry& e : entries) rows.push_back(row_of(e));
  out.text = table_of(rows);
  for (const Entry& e : entries)
    if (!e.live.is_null()) out.text += live_text(e);
  return out;
}

}  // namespace echofuse::acquire
