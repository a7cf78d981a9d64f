// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "acquire/record/data_set_part.hpp"
#include "acquire/record/schema.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/uuid.hpp"
#include "drivers/core/crc32c.hpp"
#include "drivers/core/staged_file.hpp"

namespace echofuse::record {
namespace {

struct Input {
  std::string path;
  RunInfo info;
  Corrections corrections;
  std::int64_t first = 0, count = 0, whole = 0;
};

Input look_at(const std::string& path) {
  const RunReader run(path);  // what is in it is what a run may hold
  Input out{path, run.info(), Corrections(run), 0, run.count(), 0};
  const auto whole = part_of_records(out.info);
  if (!whole || out.info.status != "complete")
    throw Error(ExitCode::failed, printable(path) + ": is " +
                                      (whole ? out.info.status : "no part of a data set") +
                                      "; expected a whole part, of `echofuse-sim dataset --part`");
  out.whole = *whole;
  out.first = first_index(run);
  if (out.count > 0 && run.summary().last_index != out.first + out.count - 1)
    throw Error(ExitCode::failed,
                printable(path) + ": damaged: its records do not follow each other");
  return out;
}

std::string records_text(std::int64_t begin, std::int64_t end) {
  return "records " + std::to_string(begin) + " to " + std::to_string(end - 1);
}

// Sorted by their records, of which each is there once.
std::vector<Input> inputs_of(const std::vector<std::string>& paths) {
  std::vector<Input> out;
  for (const auto& path : paths) out.push_back(look_at(path));
  const auto refuse = [](const std::string& text) { throw Error(ExitCode::failed, text); };
  for (const Input& part : out)
    if (part.info.uuid != out[0].info.uuid || part.whole != out[0].whole)
      refuse(printable(part.path) + ": is of another data set than " + printable(paths[0]));
  for (const Input& part : out)
    if (part.corrections != out[0].corrections)
      refuse(printable(part.path) + ": has another calibration than " + printable(paths[0]));
  std::erase_if(out, [](const Input& part) { return part.count == 0; });
  std::sort(out.begin(), out.end(),
            [](const Input& a, const Input& b) { return a.first < b.first; });
  std::int64_t next = 0;
  for (const Input& part : out) {
    if (part.first < next)
      refuse(printable(part.path) + ": " +
             records_text(part.first, std::min(next, part.first + part.count)) +
             " are in another part, too");
    if (part.first > next)
      refuse(records_text(next, part.first) + " are missing: no part has them");
    next = part.first + part.count;
  }
  const std::int64_t whole = out.empty() ? 0 : out[0].whole;
  if (next < whole) refuse(records_text(next, whole) + " are missing: no part has them");
  return out;
}

// Names of the schema's tables that are by record, and "column, column" of each that a part has.
std::vector<std::pair<std::string, std::string>> tables_by_record(sqlite3* db,
                                                                  const std::string& path) {
  std::vector<std::pair<std::string, std::string>> out;
  Statement tables(
      db, path,
      "SELECT name FROM sqlite_schema s WHERE type = 'table' AND EXISTS (SELECT 1 FROM "
      "pragma_table_info(s.name) WHERE name = 'idx')");
  while (tables.step()) {
    const std::string name = tables.text();
    Statement columns(db, path,
                      "SELECT group_concat(name, ', ') FROM pragma_table_info(?) WHERE name IN "
                      "(SELECT name FROM pragma_table_info(?, 'part'))");
    columns.bind(name).bind(name).step();
    out.emplace_back(name, columns.text());
  }
  return out;
}

void append(sqlite3* db, const std::string& path, const std::string& part) {
  Statement attach(db, path, "ATTACH ? AS part");
  attach.bind(part).run();
  for (const auto& [table, columns] : tables_by_record(db, path)) {
    const std::string sql = "INSERT INTO main." + table + " (" + columns + ") SELECT " + columns +
                            " FROM part." + table + " ORDER BY idx";
    execute(db, path, sql.c_str(), "cannot take a part's records");
  }
  execute(db, path, "DETACH part", "cannot leave a part");
}

// Of several machines each once.
std::string hosts_of(const std::vector<Input>& parts) {
  std::set<std::string> names;
  for (const Input& part : parts) names.insert(part.info.host);
  std::string out;
  for (const auto& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

}  // namespace

// FNV-1a of 64 bits, CRC-32C, and the length of the text.
std::string data_set_uuid(const RunInfo& info, const std::string& files) {
  const std::string text = info.version + "\n" + info.config_resolved + "\n" + files;
  std::uint64_t mixed = 0xcbf29ce484222325;
  for (const char c : text) mixed = (mixed ^ static_cast<std::uint8_t>(c)) * 0x100000001b3;
  return uuid_text({static_cast<std::uint32_t>(mixed >> 32), static_cast<std::uint32_t>(mixed),
                    crc32c({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}),
                    static_cast<std::uint32_t>(text.size())},
                   8);
}

std::int64_t first_index(const RunReader& run) {
  std::int64_t out = 0;
  run.for_each([&](const FusedRecord& r) { return out = r.index, false; }, 0, {}, {});
  return out;
}

std::optional<std::int64_t> part_of_records(const RunInfo& info) {
  for (const auto& [key, value] : info.meta)
    if (key == part_of_key && !value.empty() && value.size() < 18 &&
        std::all_of(value.begin(), value.end(), [](char c) { return c >= '0' && c <= '9'; }))
      return std::stoll(value);
  return std::nullopt;
}

std::int64_t merge(const std::vector<std::string>& paths, const std::string& out) {
  if (::access(out.c_str(), F_OK) == 0)
    throw Error(ExitCode::failed, printable(out) + ": exists already; choose another name");
  const std::vector<Input> parts = inputs_of(paths);
  if (parts.empty()) throw Error(ExitCode::failed, "the parts have no records");
  StagedFile staged(out);
  std::error_code error;
  std::filesystem::copy_file(parts[0].path, staged.path(), error);
  if (error) throw Error(ExitCode::disk, printable(staged.path()) + ": " + error.message());
  {
    const DatabaseHandle file = open_database(staged.path(), "cannot open");
    sqlite3* const db = file.get();
    const std::string& path = staged.path();
    // Nothing is lost by a crash: what is not published is begun anew.
    execute(db, path, "PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF", "cannot set up");
    add_columns(db, path);
    for (std::size_t i = 1; i < parts.size(); ++i) append(db, path, parts[i].path);
    Statement run(db, path, "UPDATE run SET host = ?");
    run.bind(hosts_of(parts)).run();
    Statement meta(db, path, "DELETE FROM meta WHERE key = ?");
    meta.bind(std::string_view(part_of_key)).run();
  }
  staged.publish();
  return parts[0].whole;
}

}  // namespace echofuse::record
