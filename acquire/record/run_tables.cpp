// SPDX-License-Identifier: MIT
#include "acquire/record/run_tables.hpp"

#include <algorithm>
#include <map>
#include <set>

#include "acquire/record/schema.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {
namespace {

// "idx INTEGER PRIMARY KEY", "label TEXT": as SQLite understood them, with all that a column can do
// when it is read or left out.
using Columns = std::set<std::string>;

Columns columns_of(sqlite3* db, const std::string& path, const std::string& table) {
  constexpr const char* sql =
      "SELECT name || iif(type = '', '', ' ' || type) || iif(pk, ' PRIMARY KEY', '') || "
      "iif(\"notnull\", ' NOT NULL', '') || iif(hidden, ' computed', '') || "
      "ifnull(' DEFAULT ' || dflt_value, '') FROM pragma_table_xinfo(?)";
  Statement rows(db, path, sql);
  rows.bind(table);
  Columns out;
  while (rows.step()) out.insert(rows.text());
  return out;
}

struct Table {
  std::string sql;  // that makes it, as SQLite keeps it
  Columns columns;
};

std::map<std::string, Table> tables_of_a_run() {
  const std::string name = ":memory:";
  const DatabaseHandle db = open_database(name, "cannot open", SQLITE_OPEN_MEMORY);
  execute(db.get(), name, schema, "cannot create the tables");
  std::map<std::string, Table> out;
  Statement tables(db.get(), name, "SELECT name, sql FROM sqlite_schema WHERE type = 'table'");
  while (tables.step()) {
    const std::string table = tables.text();
    out[table] = {tables.text(), columns_of(db.get(), name, table)};
  }
  return out;
}

int spend(void* budget) { return --static_cast<Budget*>(budget)->left < 0; }

}  // namespace

Budget Budget::of_file(std::uint64_t bytes) {
  constexpr std::int64_t steps_at_least = 200, instructions_a_byte = 4, mib = 1 << 20;
  const auto size = static_cast<std::int64_t>(bytes);
  Budget out;
  out.all = out.left = steps_at_least + size / instructions_a_step * instructions_a_byte;
  out.bytes = 2 * size + 64 * mib;  // a live run grows
  // 128 MiB: an SPD histogram of 2^24 bins and a depth image of 2^23 pixels.
  out.longest_value = static_cast<int>(std::clamp(size, 16 * mib, 128 * mib));
  return out;
}

void harden(sqlite3* db) {
  sqlite3_db_config(db, SQLITE_DBCONFIG_DEFENSIVE, 1, static_cast<int*>(nullptr));
  for (const int off : {SQLITE_DBCONFIG_TRUSTED_SCHEMA, SQLITE_DBCONFIG_ENABLE_VIEW,
                        SQLITE_DBCONFIG_ENABLE_TRIGGER})
    sqlite3_db_config(db, off, 0, static_cast<int*>(nullptr));
  sqlite3_limit(db, SQLITE_LIMIT_SQL_LENGTH, 100'000);
  sqlite3_exec(db, "PRAGMA cell_size_check=ON; PRAGMA ignore_check_constraints=ON", nullptr,
               nullptr, nullptr);
}

void limit(sqlite3* db, Budget& budget) {
  sqlite3_limit(db, SQLITE_LIMIT_LENGTH, budget.longest_value);
  sqlite3_progress_handler(db, Budget::instructions_a_step, spend, &budget);
}

// First the names: SQLite would run what a view or a virtual table is made of to tell its columns.
void check_tables(sqlite3* db, const std::string& path) {
  static const auto known = tables_of_a_run();  // once: a folder may have a thousand runs
  std::set<std::string> other;  // made by other words than ours, as those of older versions are
  Statement entries(db, path, "SELECT type, name, ifnull(sql, ''), rootpage FROM sqlite_schema");
  while (entries.step()) {
    const std::string type = entries.text(), name = entries.text(), sql = entries.text();
    const bool of_a_key = sql.empty() && type == "index", stored = entries.integer() > 0;
    if (of_a_key && name.starts_with("sqlite_autoindex_")) continue;
    if (type != "table" || !stored || !known.contains(name))
      throw Error(ExitCode::failed, printable(path) + ": holds the " + printable(type, 20) + " \"" +
                                        printable(name, 40) +
                                        "\"; expected the tables of a run only");
    if (sql != known.at(name).sql) other.insert(name);
  }
  for (const std::string& name : other)
    for (const std::string& column : columns_of(db, path, name))
      if (!known.at(name).columns.contains(column))
        throw Error(ExitCode::failed, printable(path) + ": its table " + name +
                                          " has the column \"" + printable(column, 60) +
                                          "\", which that of a run has not");
}

}  // namespace echofuse::record
