// SPDX-License-Identifier: MIT
#include "acquire/record/catalogue.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "acquire/commands/commands.hpp"
#include "acquire/record/catalogue.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

struct ListedRun {
  record::RunEntry run;
  Json live;  // null if the run is not live
};

Json live_state(const record::RunReader& run, const record::RunSummary& sum, const Clock& clock) {
  Json out{{"last_index", nullptr}, {"age_s", nullptr}, {"label", ""}};
  out["sensors"] = Json::object();
  if (sum.records == 0) return out;
  const record::FusedRecord last = run.outlines(sum.last_index).at(0);
  out["last_index"] = last.index;
  out["age_s"] = std::max(0.0, seconds(clock.utc() - sum.last_utc));
  out["label"] = last.label;
  for (const Sensor s : all_sensors)
    out["sensors"][name_of(s)] = {{"verdict", last.sync[s].verdict.text()},
                                  {"valid", last.valid.contains(s)},
                                  {"used", last.sync[s].used},
                                  {"lost", sum.lost[s]}};
  return out;
}

std::string percent(std::int64_t part, std::int64_t whole) {
  const auto share = 100.0 * static_cast<double>(part) / static_cast<double>(whole);
  return whole > 0 ? std::to_string(std::lround(std::floor(share))) : "-";
}

constexpr std::size_t columns = 10;
using TableRow = std::array<std::string, columns>;
const TableRow titles{"run",   "started (UTC)", "length",   "records", "valid %",
                      "state", "labels",        "operator", "notes",   "verdict"};

TableRow row_of(const ListedRun& e) {
  // Maximum length of a table entry in bytes. Longer entries are shortened, except with --json.
  constexpr std::size_t longest = 40;
  const auto short_text = [](const std::string& text) { return printable(text, longest); };
  std::string labels, notes;
  for (const auto& [label, count] : e.run.sum.labels)
    if (!label.empty()) labels.append(labels.empty() ? "" : ", ") += label;
  for (const auto& note : e.run.notes) notes.append(notes.empty() ? "" : "; ") += note;
  std::string valid;
  for (const Sensor s : all_sensors)
    valid.append(valid.empty() ? "" : " ") += percent(e.run.sum.valid[s], e.run.sum.records);
  return {short_text(e.run.name()),
          short_text(e.run.info.started_utc.substr(0, 16)),
          human_duration(std::max(0.0, e.run.length_s())),
          std::to_string(e.run.sum.records),
          valid,
          e.live.is_null() ? short_text(e.run.info.status) : "live",
          short_text(labels),
          short_text(e.run.info.operator_name),
          short_text(notes),
          printable(e.run.sum.verdicts.doubts(), 2 * longest)};
}

std::string table_of(const std::vector<TableRow>& rows) {
  std::array<std::size_t, columns> widths{};
  for (const TableRow& row : rows)
    for (std::size_t c = 0; c < columns; ++c) widths[c] = std::max(widths[c], row[c].size());
  std::string out;
  for (const TableRow& row : rows) {
    std::string line;
    for (std::size_t c = 0; c < columns; ++c)
      line += row[c] + std::string(widths[c] - row[c].size() + 2, ' ');
    line.erase(line.find_last_not_of(' ') + 1);
    out += line + "\n";
  }
  return out;
}

std::string live_text(const ListedRun& e) {
  std::string out = "\n";
  out += printable(e.run.path) + " is live";
  if (!e.live["age_s"].is_null())
    out += "; its last record is " + human_duration(e.live["age_s"].get<double>()) + " old";
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

Catalogue list_runs(const std::string& folder, const Clock& clock, bool json) {
  Catalogue out;
  std::vector<ListedRun> entries;
  for (const std::string& path : record::run_files(folder)) {
    try {
      const record::RunReader run(path);
      ListedRun e{record::entry_of(run), {}};
      if (e.run.info.status == "open") e.live = live_state(run, e.run.sum, clock);
      entries.push_back(std::move(e));
    } catch (const Error& e) {
      out.left_out.append(out.left_out.empty() ? "" : "\n") += e.what();
    }
  }
  std::stable_sort(entries.begin(), entries.end(), [](const ListedRun& a, const ListedRun& b) {
    return a.run.info.started_utc < b.run.info.started_utc;
  });
  if (json) {
    Json all = Json::array();
    for (const ListedRun& e : entries) {
      all.push_back(record::to_json(e.run));
      all.back()["live"] = e.live;
    }
    out.text =
        Json{{"schema", 1}, {"runs", all}}.dump(2, ' ', true, Json::error_handler_t::replace) +
        "\n";
    return out;
  }
  std::vector<TableRow> rows{titles};
  for (const ListedRun& e : entries) rows.push_back(row_of(e));
  out.text = table_of(rows);
  for (const ListedRun& e : entries) {
    if (!e.live.is_null()) out.text += live_text(e);
    for (const std::string& file : e.run.leftovers)
      out.text += printable(file) + ": not read, because the run is closed; move it away\n";
  }
  return out;
}

}  // namespace echofuse::acquire
