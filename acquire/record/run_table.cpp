// SPDX-License-Identifier: MIT
// The tables of a run as they are, for exports.
#include <algorithm>
#include <set>
#include <type_traits>

#include "acquire/record/run_parts.hpp"
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

// The rows of the later part go behind those of the earlier one.
void add_rows(std::vector<Column>& rows, const std::vector<Column>& later,
              const std::string& table) {
  if (!std::ranges::equal(rows, later, {}, &Column::name, &Column::name))
    throw Error(ExitCode::failed, "its parts have other columns of the table " + table +
                                      ", as of another version; export them one by one");
  for (std::size_t c = 0; c < rows.size(); ++c)
    std::visit(
        [&](auto& values) {
          const auto& more = std::get<std::remove_reference_t<decltype(values)>>(later[c].values);
          values.insert(values.end(), more.begin(), more.end());
        },
        rows[c].values);
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

std::map<std::string, std::vector<Column>> joined_tables(const std::vector<std::string>& files) {
  const std::set<std::string> copied{"antenna", "axis", "calibration", "device", "meta", "policy"};
  std::map<std::string, std::vector<Column>> out;
  for (const std::string& file : files) {
    const RunReader run(file);
    for (const std::string& name : run.table_names())
      if (const auto [table, first] = out.try_emplace(name); first || copied.contains(name))
        table->second = run.table(name);
      else
        add_rows(table->second, run.table(name), name);
  }
  return out;
}

}  // namespace echofuse::record
