// SPDX-License-Identifier: MIT
#include "recon/study/study_file.hpp"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "acquire/record/rescue.hpp"
#include "acquire/record/sqlite.hpp"
#include "drivers/core/console.hpp"
#include "drivers/core/printable.hpp"
#include "recon/files/files.hpp"

namespace echofuse::recon {
namespace {

constexpr std::int64_t application_id = 0x45434653;  // "ECFS"
constexpr int longest_wait_ms = 30'000;  // for a reader, or a second study in the folder

constexpr const char* schema = R"(
CREATE TABLE IF NOT EXISTS setting (key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE IF NOT EXISTS machine (axis TEXT, value TEXT, model TEXT, inputs TEXT,
  seed INTEGER, name TEXT, PRIMARY KEY (axis, value, model, inputs, seed));
CREATE TABLE IF NOT EXISTS measurement (axis TEXT, value TEXT, model TEXT, inputs TEXT,
  seed INTEGER, metric TEXT, score REAL,
  PRIMARY KEY (axis, value, model, inputs, seed, metric));
)";

constexpr const char* all_settings = "SELECT key, value FROM setting";
constexpr const char* all_measurements =
    "SELECT axis, value, model, inputs, metric, ifnull((SELECT name FROM machine x WHERE x.axis = "
    "m.axis AND x.value = m.value AND x.model = m.model AND x.inputs = m.inputs AND x.seed = "
    "m.seed), ''), seed, score FROM measurement m ORDER BY rowid";

// Names go into tables, and into a script that a shell reads.
bool is_name(const std::string& text) {
  return !text.empty() && text.size() < 100 && std::ranges::all_of(text, [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
           std::string_view(" ._+-").find(c) != std::string_view::npos;
  });
}

// Exports of a study are its own, those of another one are not.
std::string path_in(const std::string& folder, const std::string& study) {
  make_folder(folder);
  std::string path = folder + "/study.sqlite";
  if (std::filesystem::exists(path)) return path;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().stem() == study)
      throw Error(ExitCode::usage, printable(entry.path().string()) +
                                       ": is of a study whose study.sqlite is missing; give "
                                       "another --out");
  return path;
}

}  // namespace

StudyFile::Place StudyFile::place_of(const StudyOptions& options, const std::string& study) {
  if (!options.part) return {path_in(options.out, study), nullptr};
  make_folder(options.out);
  auto staged = std::make_unique<StagedFile>(options.out + "/" + options.part->name() + ".sqlite");
  return {staged->path(), std::move(staged)};
}

StudyFile::StudyFile(const StudyOptions& options, const StudySettings& settings, ExitCode refusal)
    : StudyFile(place_of(options, settings[0].second), settings, refusal, SQLITE_OPEN_CREATE) {
  std::vector<std::string> files;
  if (const std::string whole = options.out + "/study.sqlite";
      place_.staged && std::filesystem::exists(whole))
    files.push_back(whole);
  for (const auto& part : part_files(options.out, "", ".sqlite")) files.push_back(part);
  for (const std::string& path : files) {
    StudyFile part(Place{path, nullptr}, settings, refusal, 0);
    // A part that is measured again, as with more models, keeps what it has.
    if (place_.staged &&
        std::filesystem::path(path) == std::filesystem::path(place_.staged->place()))
      add(part.stored());
    for (Measurement& m : part.stored()) {
      const Key key = m.key();
      if (elsewhere_.emplace(key, std::move(m)).second) order_.push_back(key);
    }
  }
}

StudyFile::StudyFile(Place place, const StudySettings& settings, ExitCode refusal, int flags)
    : place_(std::move(place)), db_(nullptr, sqlite3_close) {
  try {
    db_ = record::open_database(path_, "cannot open", flags);
    sqlite3* const db = db_.get();
    record::harden(db);
    sqlite3_busy_timeout(db, longest_wait_ms);
    if (flags && !ask("SELECT 1 FROM sqlite_schema").step()) begin(settings);
    record::Statement id = ask("PRAGMA application_id");
    if (!id.step() || id.integer() != application_id)
      throw Error(ExitCode::config, printable(path_) + ": is not the file of a study");
    record::check_tables(db, path_, schema, "a study");
    for (const char* sql : {all_settings, all_measurements}) ask(sql);  // has it all columns?
  } catch (const Error& error) {
    const bool damaged = sqlite3_errcode(db_.get()) == SQLITE_CORRUPT;
    if (error.code() != ExitCode::failed || damaged) throw;
    throw Error(ExitCode::config, error.what());
  }
  if (const std::string fault = record::damage(db_.get(), path_); !fault.empty())
    throw Error(ExitCode::failed, printable(path_) + ": damaged: " + printable(fault, 200));
  check(settings, refusal);
}

// In one transaction: a kill leaves an empty file or a study.
void StudyFile::begin(const StudySettings& settings) {
  const std::string tables =
      "BEGIN IMMEDIATE; PRAGMA application_id=" + std::to_string(application_id) + ";" + schema;
  record::execute(db_.get(), path_, tables.c_str(), "cannot begin a study");
  record::Statement row = ask("INSERT OR IGNORE INTO setting (key, value) VALUES (?, ?)");
  for (const auto& [key, value] : settings) row.bind(key).bind(value).run();
  record::execute(db_.get(), path_, "COMMIT", "cannot begin a study");
}

void StudyFile::check(const StudySettings& settings, ExitCode refusal) {
  std::map<std::string, std::string> there;
  record::Statement rows = ask(all_settings);
  while (rows.step()) {
    const std::string key = rows.text();
    there[key] = rows.text();
  }
  std::string differ;
  for (const auto& [key, now] : settings) {
    if (there[key] == now) continue;
    differ += (differ.empty() ? "" : ", ") + key + " " + printable(there[key], 100) +
              " (now: " + printable(now, 100) + ")";
    if (key == settings[0].first) break;  // another study has other keys
  }
  if (!differ.empty())
    throw Error(refusal, printable(path_) + ": was measured with " + differ +
                             "; give the same settings, or another folder or file");
}

// The file grows.
void StudyFile::limit() {
  std::error_code code;
  const auto bytes = std::filesystem::file_size(path_, code);
  budget_ = record::Budget::of_file(code ? 0 : bytes);
  record::limit(db_.get(), budget_);
}

record::Statement StudyFile::ask(const char* sql) {
  limit();
  return {db_.get(), path_, sql, budget_.bytes};
}

bool StudyFile::has(const Measurement& m, const std::string& metric) {
  record::Statement found =
      ask("SELECT 1 FROM measurement WHERE axis = ? AND value = ? AND model = ? AND inputs = ? AND "
          "seed = ? AND (?6 = '' OR metric = ?6)");
  found.bind(m.axis).bind(m.value).bind(m.model).bind(m.inputs).bind(m.seed).bind(metric);
  if (found.step()) return true;
  const auto other = elsewhere_.find(m.key());
  return other != elsewhere_.end() && (metric.empty() || other->second.metrics.contains(metric));
}

void StudyFile::keep(const Measurement& m) {
  const auto found = elsewhere_.find(m.key());
  if (!place_.staged && found != elsewhere_.end()) kept_.push_back(found->second);
}

void StudyFile::finish() {
  if (!place_.staged) return;
  db_.reset();
  place_.staged->publish();
}

void StudyFile::add(std::span<const Measurement> measurements) {
  std::vector<Measurement> all = std::exchange(kept_, {});
  all.insert(all.end(), measurements.begin(), measurements.end());
  for (const Measurement& m : all)  // what cannot be read again is not measured for hours
    for (const std::string& name : {m.axis, m.value, m.model, m.inputs})
      if (!is_name(name)) throw Error(ExitCode::failed, "\"" + name + "\" is no name of a study");
  if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; the same command goes on");
  limit();
  record::execute(db_.get(), path_, "BEGIN IMMEDIATE", "cannot keep a measurement");
  record::Statement row =
      ask("INSERT OR IGNORE INTO measurement (axis, value, model, inputs, seed, metric, score) "
          "VALUES (?, ?, ?, ?, ?, ?, ?)");
  record::Statement machine =
      ask("INSERT OR IGNORE INTO machine (axis, value, model, inputs, seed, name) VALUES (?, ?, ?, "
          "?, ?, ?)");
  for (const Measurement& m : all) {
    limit();
    if (!m.machine.empty()) {
      machine.bind(m.axis).bind(m.value).bind(m.model).bind(m.inputs).bind(m.seed);
      machine.bind(m.machine).run();
    }
    for (const auto& [name, score] : m.metrics) {
      row.bind(m.axis).bind(m.value).bind(m.model).bind(m.inputs).bind(m.seed);
      row.bind(name).bind(score).run();
    }
  }
  record::execute(db_.get(), path_, "COMMIT", "cannot keep a measurement");
}

std::vector<Measurement> StudyFile::all() {
  for (const Key& key : order_) keep(elsewhere_.at(key));
  if (!kept_.empty()) add({});
  return stored();
}

std::vector<Measurement> StudyFile::stored() {
  record::Statement rows = ask(all_measurements);
  std::vector<Measurement> out;
  while (rows.step()) {
    Measurement m;
    std::string metric;
    for (std::string* text : {&m.axis, &m.value, &m.model, &m.inputs, &metric, &m.machine}) {
      *text = rows.text();
      if (text == &m.machine && text->empty()) continue;
      if (!is_name(*text))
        throw Error(ExitCode::failed, printable(path_) + ": damaged: \"" + printable(*text, 100) +
                                          "\" is no name of a study");
    }
    m.seed = static_cast<std::size_t>(rows.integer());
    if (out.empty() || out.back().key() != m.key()) out.push_back(m);
    const bool undefined = rows.next_is_null();
    const double score = rows.real();
    out.back().metrics[metric] = undefined ? std::numeric_limits<double>::quiet_NaN() : score;
  }
  return out;
}

}  // namespace echofuse::recon
