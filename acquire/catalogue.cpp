// SPDX-License-Identifier: MIT
#include "acquire/catalogue.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/console.hpp"
#include "drivers/core/printable.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Entry {
  std::string name;
  record::RunInfo info;
  record::RunSummary sum;
  std::vector<std::string> notes;

  double length_s() const { return seconds(sum.last_utc) - seconds(sum.first_utc); }
};

Entry read_entry(const fs::path& path) {
  const record::RunReader run(path.string());
  Entry e{.name = path.stem().string(), .info = run.info(), .sum = run.summary(), .notes = {}};
  if (!e.info.notes.empty()) e.notes.push_back(e.info.notes);
  for (const record::Event& event : run.events())
    if (event.level == "note") e.notes.push_back(event.text);
  return e;
}

std::vector<fs::path> run_files(const std::string& folder) {
  std::error_code error;
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".sqlite" && entry.is_regular_file(error))
      paths.push_back(entry.path());
  if (error) throw Error(ExitCode::failed, printable(folder) + ": " + error.message());
  std::sort(paths.begin(), paths.end());
  return paths;
}

Json to_json(const Entry& e) {
  Json valid = Json::object();
  for (const Sensor s : all_sensors) valid[name_of(s)] = e.sum.valid[s];
  return {
      {"name", e.name},           {"started_utc", e.info.started_utc}, {"length_s", e.length_s()},
      {"records", e.sum.records}, {"status", e.info.status},           {"valid", valid},
      {"labels", e.sum.labels},   {"operator", e.info.operator_name},  {"notes", e.notes}};
}

std::string percent(std::int64_t part, std::int64_t whole) {
  const auto share = 100.0 * static_cast<double>(part) / static_cast<double>(whole);
  return whole > 0 ? std::to_string(std::lround(std::floor(share))) : "-";
}

constexpr std::size_t columns = 9;
using Row = std::array<std::string, columns>;
const Row titles{"run",   "started (UTC)", "length",   "records", "valid %",
                 "state", "labels",        "operator", "notes"};

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
  return {short_text(e.name),
          short_text(e.info.started_utc.substr(0, 16)),
          human_duration(std::max(0.0, e.length_s())),
          std::to_string(e.sum.records),
          valid,
          short_text(e.info.status),
          short_text(labels),
          short_text(e.info.operator_name),
          short_text(notes)};
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

}  // namespace

Catalogue list_runs(const std::string& folder, bool json) {
  Catalogue out;
  std::vector<Entry> entries;
  for (const fs::path& path : run_files(folder)) {
    try {
      entries.push_back(read_entry(path));
    } catch (const Error& e) {
      out.left_out.append(out.left_out.empty() ? "" : "\n") += e.what();
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
  return out;
}

}  // namespace echofuse::acquire
