// SPDX-License-Identifier: MIT
#include "acquire/record/run_guard.hpp"

#include <algorithm>
#include <cctype>
#include <set>

#include "acquire/record/rows.hpp"
#include "drivers/util/caused_error.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::record {
namespace {

std::int64_t pragma(sqlite3* db, const std::string& path, const char* sql) {
  Statement s(db, path, sql);
  return s.step() ? s.integer() : 0;
}

int spend(void* budget) { return --static_cast<Budget*>(budget)->left < 0; }

}  // namespace

Budget Budget::of_file(std::uint64_t bytes) {
  constexpr std::int64_t min_steps = 200, instructions_a_byte = 4, mib = 1 << 20;
  const auto size = static_cast<std::int64_t>(bytes);
  Budget out;
  out.all = out.left = min_steps + size / instructions_a_step * instructions_a_byte;
  out.bytes = 2 * size + 64 * mib;  // a live run may grow while it is read
  // 128 MiB can hold an SPD histogram of 2^24 bins and a depth image of 2^23 pixels.
  out.longest_value = static_cast<int>(std::clamp(size, 16 * mib, 128 * mib));
  return out;
}

void harden(sqlite3* db) {
  sqlite3_db_config(db, SQLITE_DBCONFIG_DEFENSIVE, 1, static_cast<int*>(nullptr));
  for (const int off : {SQLITE_DBCONFIG_TRUSTED_SCHEMA, SQLITE_DBCONFIG_ENABLE_VIEW,
                        SQLITE_DBCONFIG_ENABLE_TRIGGER})
    sqlite3_db_config(db, off, 0, static_cast<int*>(nullptr));
  sqlite3_limit(db, SQLITE_LIMIT_SQL_LENGTH, 100'000);
  sqlite3_exec(db, "PRAGMA cell_size_check=ON", nullptr, nullptr, nullptr);
}

void limit(sqlite3* db, Budget& budget) {
  sqlite3_limit(db, SQLITE_LIMIT_LENGTH, budget.longest_value);
  sqlite3_progress_handler(db, Budget::instructions_a_step, spend, &budget);
}

int probe(sqlite3* db) {
  return sqlite3_exec(db, "SELECT 1 FROM sqlite_schema", nullptr, nullptr, nullptr);
}

// Returns true if the file begins like a safetensors file: 8 bytes with the length of the header,
// then "{".
bool is_model(const std::string& path) {
  const auto start = RegularFile(path, ExitCode::failed).rest<std::string>(9);
  return start.size() > 8 && start[8] == '{';
}

void check_identity(sqlite3* db, const std::string& path) {
  const std::string shown = printable(path);
  const int code = probe(db);
  if (code == SQLITE_BUSY || code == SQLITE_LOCKED)
    throw CausedError(Cause::in_use, shown + ": is in use by another program; try again");
  if (code == SQLITE_IOERR || code == SQLITE_CANTOPEN || code == SQLITE_NOMEM)
    throw CausedError(Cause::unreadable, shown + ": cannot be read: " + sqlite3_errmsg(db));
  if (code == SQLITE_CORRUPT)
    throw Error(ExitCode::failed, shown + ": damaged: " + sqlite3_errmsg(db));
  if (code == SQLITE_OK && pragma(db, path, "SELECT count(*) FROM sqlite_schema") == 0)
    throw Error(ExitCode::failed,
                shown +
                    ": is empty: the recording process was killed before the first record, or the "
                    "records were in " +
                    shown + "-wal, which is missing; look for a copy named *.rescued.sqlite");
  if (code != SQLITE_OK || pragma(db, path, "PRAGMA application_id") != application_id)
    throw CausedError(Cause::other_format,
                      shown + (is_model(path) ? ": is a model; expected a run file"
                                              : ": not an echofuse run file"));
  const auto found = pragma(db, path, "PRAGMA user_version");
  if (found != format_version)
    throw CausedError(Cause::other_format,
                      shown + ": run format " + std::to_string(found) + ", expected " +
                          std::to_string(format_version) + "; " +
                          (found > format_version ? "use a newer echofuse"
                           : found == 3 ? "convert it: python3 -m echofuse.runs.convert OLD NEW"
                                        : "use the echofuse that recorded it"));
}

// Returns the advice to remove an entry from the schema, with the SQL statement that removes it.
std::string removal(const std::string& type, const std::string& name) {
  std::string quoted;
  for (const char c : name) quoted += c == '"' ? "\"\"" : std::string(1, c);
  std::string kind = type;
  for (char& c : kind) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return "; remove it with: DROP " + printable(kind, 20) + " \"" + printable(quoted, 80) + "\"";
}

// Requires that each table has exactly the SQL definition given in rows.hpp, so that queries cannot
// access anything else in the file.
void check_tables(sqlite3* db, const std::string& path) {
  static const auto known = table_definitions();
  const auto refuse = [&](const std::string& what) {
    throw Error(ExitCode::failed, printable(path) + ": " + what);
  };
  std::set<std::string> found;
  Statement entries(db, path, "SELECT type, name, ifnull(sql, ''), rootpage FROM sqlite_schema");
  while (entries.step()) {
    const std::string type = entries.text(), name = entries.text(), sql = entries.text();
    const bool of_a_key = sql.empty() && type == "index", stored = entries.integer() > 0;
    if (of_a_key && name.starts_with("sqlite_autoindex_")) continue;
    if (type != "table" || !stored || !known.contains(name))
      refuse("contains the " + printable(type, 20) + " \"" + printable(name, 40) +
             "\"; expected only the tables of a run" + removal(type, name));
    if (sql != known.at(name))
      refuse("its table " + name + " does not have the expected definition");
    found.insert(name);
  }
  for (const Row* table : tables())
    if (!found.contains(table->name()))
      refuse("has no table " + table->name() + "; expected all tables of a run");
}

}  // namespace echofuse::record
