// SPDX-License-Identifier: MIT
#include "acquire/record/run_tables.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include "acquire/record/sqlite.hpp"
#include "drivers/core/printable.hpp"

namespace echofuse::record {
namespace {

// "idx INTEGER PRIMARY KEY", "label TEXT"
using Columns = std::set<std::string>;

// Words with one space between them, and none beside a bracket or comma.
std::string in_one_line(std::string_view sql) {
  std::string out;
  bool space = false;
  for (const char c : sql) {
    const bool mark = c == '(' || c == ')' || c == ',';
    if (c == ' ' || c == '\n' || c == '\t' || c == '\r') {
      space = true;
      continue;
    }
    if (space && !mark && !out.empty() && out.back() != '(' && out.back() != ',') out += ' ';
    space = false;
    out += c;
  }
  return out;
}

// Of "CREATE TABLE NAME(COLUMN,COLUMN)"; nothing for any other text.
std::optional<Columns> columns_of(const std::string& sql, const std::string& name) {
  const std::string text = in_one_line(sql), head = "CREATE TABLE " + name + "(";
  if (!text.starts_with(head) || !text.ends_with(')')) return std::nullopt;
  Columns out;
  const std::size_t end = text.size() - 1;
  for (std::size_t at = head.size(); at <= end;) {
    const std::size_t comma = std::min(text.find(',', at), end);
    out.insert(text.substr(at, comma - at));
    at = comma + 1;
  }
  return out;
}

using Tables = std::map<std::string, Columns>;

Tables tables_of(const std::string& all) {
  const std::string begin = "CREATE TABLE IF NOT EXISTS ";
  Tables out;
  for (std::size_t at = all.find(begin); at != all.npos; at = all.find(begin, at)) {
    at += begin.size();
    const std::string name = all.substr(at, all.find_first_of(" (", at) - at);
    const std::string rest = all.substr(at, all.find(';', at) - at);
    out[name] = *columns_of("CREATE TABLE " + rest, name);
  }
  return out;
}

// What is wrong with an entry of sqlite_schema, or nothing.
std::string fault_of(const Tables& known, const std::string& of, const std::string& type,
                     const std::string& name, const std::string& sql) {
  if (type == "index" && sql.empty() && name.starts_with("sqlite_autoindex_")) return {};
  const auto table = known.find(name);
  if (type != "table" || table == known.end())
    return "holds the " + printable(type, 20) + " \"" + printable(name, 40) +
           "\"; expected the tables of " + of + " only";
  const auto columns = columns_of(sql, name);
  if (!columns) return "its table " + name + " is not that of " + of;
  for (const auto& column : *columns)
    if (!table->second.contains(column))
      return "its table " + name + " has the column \"" + printable(column, 40) +
             "\", which that of " + of + " has not";
  return {};
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
  sqlite3_limit(db, SQLITE_LIMIT_COLUMN, 100);
  sqlite3_limit(db, SQLITE_LIMIT_EXPR_DEPTH, 20);
  sqlite3_limit(db, SQLITE_LIMIT_ATTACHED, 0);
  sqlite3_exec(db, "PRAGMA cell_size_check=ON", nullptr, nullptr, nullptr);
}

void limit(sqlite3* db, Budget& budget) {
  sqlite3_limit(db, SQLITE_LIMIT_LENGTH, budget.longest_value);
  sqlite3_progress_handler(db, Budget::instructions_a_step, spend, &budget);
}

void check_tables(sqlite3* db, const std::string& path, const std::string& schema,
                  const std::string& of) {
  const Tables known = tables_of(schema);
  Statement entries(db, path, "SELECT type, name, ifnull(sql, '') FROM sqlite_schema");
  while (entries.step()) {
    const std::string type = entries.text(), name = entries.text();
    if (const std::string fault = fault_of(known, of, type, name, entries.text()); !fault.empty())
      throw Error(ExitCode::failed, printable(path) + ": " + fault);
  }
}

}  // namespace echofuse::record
