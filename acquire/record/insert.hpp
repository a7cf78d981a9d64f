// SPDX-License-Identifier: MIT
// Rows of the run file's tables, by the names of their columns.
#pragma once
#include <map>
#include <optional>
#include <string>

#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

// Rows for one table. The statement is prepared once.
class Insert {
 public:
  // Both must outlive this. `conflict`: what SQLite does with a row whose key is there already.
  Insert(sqlite3* db, const std::string& path, const std::string& table,
         const std::string& conflict)
      : statement_(db, path, sql(db, path, table, conflict).c_str()) {}

  // The value of a column in the next row; one that is not set is NULL. The bytes of a view must
  // live until run().
  template <class T>
  Insert& set(const std::string& column, const T& value) {
    statement_.at(column).bind(value);
    return *this;
  }
  template <class T>
  Insert& set(const std::string& column, const std::optional<T>& value) {
    return value ? set(column, *value) : *this;
  }
  void run() { statement_.run(); }

 private:
  static std::string sql(sqlite3* db, const std::string& path, const std::string& table,
                         const std::string& conflict) {
    Statement column(db, path, "SELECT name FROM pragma_table_info(?)");
    column.bind(table);
    std::string names, values;
    while (column.step()) {
      const std::string name = column.text();
      names += (names.empty() ? "" : ", ") + name;
      values += (values.empty() ? ":" : ", :") + name;
    }
    return "INSERT INTO " + table + " (" + names + ") VALUES (" + values + ") " + conflict;
  }
  Statement statement_;
};

// The tables that a writer has used so far.
class Inserts {
 public:
  Inserts(sqlite3* db, const std::string& path) : db_(db), path_(path) {}
  Insert& into(const std::string& table, const std::string& conflict = {}) {
    return tables_.try_emplace(table, db_, path_, table, conflict).first->second;
  }

 private:
  sqlite3* db_;
  const std::string& path_;
  std::map<std::string, Insert> tables_;
};

}  // namespace echofuse::record
