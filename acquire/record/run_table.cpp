// SPDX-License-Identifier: MIT
// The tables of a run as they are, for exports.
#include "acquire/record/run_file.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {
namespace {

struct Declared {
  std::string name, type;
};

Column empty_column(const Declared& declared) {
  if (declared.type == "INTEGER") return {declared.name, std::vector<std::int64_t>{}};
  if (declared.type == "REAL") return {declared.name, std::vector<double>{}};
  return {declared.name, std::vector<std::string>{}};
}

void take(Statement& row, Column& column) {
  const bool null = row.next_is_null();
  if (auto* whole = std::get_if<std::vector<std::int64_t>>(&column.values)) {
    const std::int64_t value = row.integer();
    whole->push_back(null ? null_integer : value);
  } else if (auto* real = std::get_if<std::vector<double>>(&column.values)) {
    const double value = row.real();
    real->push_back(null ? std::numeric_limits<double>::quiet_NaN() : value);
  } else {
    std::get<std::vector<std::string>>(column.values).push_back(row.text());
  }
}

}  // namespace

std::vector<std::string> RunReader::table_names() const {
  std::vector<std::string> names;
  Statement s = ask("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name");
  while (s.step()) names.push_back(s.text());
  return names;
}

// Names that check_tables() let pass are words: nothing in them ends the quotes.
std::vector<Column> RunReader::table(const std::string& name) const {
  std::vector<Column> columns;
  std::string list;
  {
    const std::string sql = "SELECT name, type FROM pragma_table_info('" + name + "')";
    Statement s = ask(sql.c_str());
    while (s.step()) {
      Declared declared;
      declared.name = s.text();
      declared.type = s.text();
      if (declared.type == "BLOB") continue;
      columns.push_back(empty_column(declared));
      list.append(list.empty() ? "\"" : ", \"").append(declared.name).append("\"");
    }
  }
  const std::string sql = "SELECT " + list + " FROM \"" + name + "\" ORDER BY rowid";
  Statement rows = ask(sql.c_str());
  while (rows.step())
    for (Column& column : columns) take(rows, column);
  return columns;
}

}  // namespace echofuse::record
