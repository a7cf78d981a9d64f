// SPDX-License-Identifier: MIT
// Tables of a run file, format 4. A function columns(Row&, T&) describes the row of a type T.
// CREATE TABLE, INSERT and SELECT are generated from it. Columns *_ns are nanoseconds of the host's
// monotonic clock, *_utc_ns nanoseconds of UTC; utc is ISO 8601. NULL means that the value is
// unknown or the sensor is missing.
#pragma once
#include <concepts>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "acquire/record/columns.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

// Visits the columns of a row in order, to list them, bind them to an INSERT, or read them from a
// SELECT. Values are changed only when reading.
class Row {
 public:
  enum class Purpose : std::uint8_t { list, write, read };
  Row() = default;
  Row(Statement& statement, Purpose does) : statement_(&statement), does_(does) {}
  bool reading() const { return does_ == Purpose::read; }
  void table(const char* name) { table_ = name; }

  void operator()(std::string_view name, std::int64_t& value) { visit(name, "INTEGER", value); }
  void operator()(std::string_view name, double& value) { visit(name, "REAL", value); }
  void operator()(std::string_view name, std::string& value) { visit(name, "TEXT", value); }
  void operator()(std::string_view name, ByteView& value) { visit(name, "BLOB", value); }
  void operator()(std::string_view name, Sensor& value);     // stored as the name of the sensor
  void operator()(std::string_view name, SensorSet& value);  // stored as a bit mask
  void operator()(std::string_view name, std::chrono::nanoseconds& value);
  template <std::integral T>
  void operator()(std::string_view name, T& value) {
    auto whole = static_cast<std::int64_t>(value);
    (*this)(name, whole);
    if (!reading()) return;
    if (!std::in_range<T>(whole)) return fail(std::string(name) + " is " + std::to_string(whole));
    value = static_cast<T>(whole);
  }
  template <class T>
  void operator()(std::string_view name, std::optional<T>& value) {
    group(value, [&](T& inner) { (*this)(name, inner); });
  }
  // Visits a group of columns, which are all NULL if `value` is empty.
  template <class T, class Columns>
  void group(std::optional<T>& value, const Columns& columns) {
    T inner = value.value_or(T{});
    const bool absent = std::exchange(absent_, absent_ || !value);
    const bool seen = std::exchange(seen_, false);
    columns(inner);
    if (reading() && seen_) value = std::move(inner);
    absent_ = absent, seen_ = seen_ || seen;
  }
  template <class T>
  void key(std::string_view name, T& value) {
    key_ = " PRIMARY KEY";
    (*this)(name, value);
  }

  void fail(const std::string& fault) {
    if (fault_.empty()) fault_ = fault;
  }
  // Returns the first invalid value that was read; empty if all values are valid.
  const std::string& fault() const { return fault_; }
  const std::string& name() const { return table_; }
  std::string create() const { return "CREATE TABLE " + table_ + " (" + declared_ + ")"; }
  std::string insert() const { return "INSERT INTO " + table_ + " VALUES (" + values_ + ")"; }
  std::string select() const { return "SELECT " + names_ + " FROM " + table_; }

 private:
  template <class T>
  void visit(std::string_view name, const char* type, T& value) {
    if (does_ == Purpose::list)
      list(name, type);
    else if (does_ == Purpose::write)
      absent_ ? statement_->skip() : static_cast<void>(statement_->bind(value));
    else if (statement_->next_is_null())
      statement_->skip_column();
    else
      seen_ = true, statement_->take(value);
  }
  void list(std::string_view name, const char* type);

  Statement* statement_ = nullptr;
  Purpose does_ = Purpose::list;
  const char* key_ = "";
  // `absent_` is true if the group to be written is empty. `seen_` is true if at least one column
  // that was read is not NULL.
  bool absent_ = false, seen_ = false;
  std::string fault_, table_, names_, declared_, values_;
};

// Row types used only in the run file.
struct DeviceRow {
  Sensor sensor{};
  std::optional<std::string> policy;  // the value is "required" or "optional"
  std::optional<DeviceInfo> info;     // empty if the device has not answered yet
};
struct LateRow {  // samples received after the slot was closed; no record contains them
  std::int64_t index = 0;
  PerSensor<std::uint64_t> samples{};
};
// The data columns are the last ones, so that the other columns can be read without them.
struct StoredRecord {
  FusedRecord record;
  Blobs blobs;
  std::string fault{};  // why the record cannot be read; not stored
};

void columns(Row& row, RunInfo& info);
void columns(Row& row, DeviceRow& device);
void columns(Row& row, CalibrationEntry& entry);
void columns(Row& row, Axis& axis);
void columns(Row& row, Antenna& antenna);
void columns(Row& row, Zone& zone);
void columns(Row& row, Anchor& anchor);
void columns(Row& row, CounterRow& counted);
void columns(Row& row, Event& event);
void columns(Row& row, LateRow& late);
void columns(Row& row, FusedRecord& record);  // visits all columns except those of Blobs
void columns(Row& row, Blobs& blobs);
void columns(Row& row, StoredRecord& stored);

// Returns the description of the table that stores objects of type T. It lists all columns.
template <class T>
const Row& table_of() {
  static const Row table = [] {
    Row row;
    T value{};
    columns(row, value);
    return row;
  }();
  return table;
}

// Tables of every run. Runs of a detector with zones also have the table `zone`.
const std::vector<const Row*>& tables();

// Returns the SQL definition of each table that a run file may contain, by the name of the table.
// These are the tables of a run, and the statistics of ANALYZE and PRAGMA optimize, which another
// program may have created.
std::map<std::string, std::string> table_definitions();

// Binds the columns of a row to an INSERT, in order, and runs it.
template <class... T>
void insert(Statement& statement, const T&... parts) {
  Row row(statement, Row::Purpose::write);
  (columns(row, const_cast<T&>(parts)), ...);  // writing does not change `parts`
  statement.run();
}
// Inserts a row. `conflict` is the SQL clause for a row with an existing key.
template <class T>
void insert(sqlite3* db, const std::string& path, const T& row, const std::string& conflict = {}) {
  Statement statement(db, path, (table_of<T>().insert() + conflict).c_str());
  insert(statement, row);
}

// Inserts an axis and, in a table of their own, the zones of a detector with several of them.
void insert_axis(sqlite3* db, const std::string& path, const Axis& axis);

// Reads the current row of a SELECT from table_of<T>(). Returns an error message; empty if the row
// is valid.
template <class T>
std::string take(Statement& statement, T& value) {
  Row row(statement, Row::Purpose::read);
  columns(row, value);
  return row.fault();
}

}  // namespace echofuse::record
