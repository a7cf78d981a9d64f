// SPDX-License-Identifier: MIT
// The tables of a run file, format 3. One function describes a row: columns(Row&, T&); CREATE
// TABLE, INSERT and SELECT are made from it. Times: *_ns are host monotonic nanoseconds, *_utc_ns
// those of UTC, utc is ISO 8601. NULL: not known, or the sensor is missing.
#pragma once
#include <concepts>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

// Visits the columns of a row in order, to list them, to bind them to an INSERT or to take them
// from a SELECT. Values change only when it reads.
class Row {
 public:
  enum class Does : std::uint8_t { list, write, read };
  Row() = default;
  Row(Statement& statement, Does does) : statement_(&statement), does_(does) {}
  bool reading() const { return does_ == Does::read; }
  void table(const char* name) { table_ = name; }

  void operator()(std::string_view name, std::int64_t& value) { visit(name, "INTEGER", value); }
  void operator()(std::string_view name, double& value) { visit(name, "REAL", value); }
  void operator()(std::string_view name, std::string& value) { visit(name, "TEXT", value); }
  void operator()(std::string_view name, ByteView& value) { visit(name, "BLOB", value); }
  void operator()(std::string_view name, Sensor& value);     // its name
  void operator()(std::string_view name, SensorSet& value);  // its bits
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
  // Columns that are all NULL without a value.
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
  // The first value of a row that was read which cannot be; empty if all can.
  const std::string& fault() const { return fault_; }
  const std::string& name() const { return table_; }
  std::string create() const { return "CREATE TABLE " + table_ + " (" + declared_ + ")"; }
  std::string insert() const { return "INSERT INTO " + table_ + " VALUES (" + values_ + ")"; }
  std::string select() const { return "SELECT " + names_ + " FROM " + table_; }

 private:
  template <class T>
  void visit(std::string_view name, const char* type, T& value) {
    if (does_ == Does::list)
      list(name, type);
    else if (does_ == Does::write)
      absent_ ? statement_->skip() : static_cast<void>(statement_->bind(value));
    else if (statement_->next_is_null())
      statement_->skip_column();
    else
      seen_ = true, statement_->take(value);
  }
  void list(std::string_view name, const char* type);

  Statement* statement_ = nullptr;
  Does does_ = Does::list;
  const char* key_ = "";
  bool absent_ = false, seen_ = false;  // group: has no value; has a column that is not NULL
  std::string fault_, table_, names_, declared_, values_;
};

// Rows that are not a type of the measurement by themselves.
struct DeviceRow {
  Sensor sensor{};
  std::optional<std::string> policy;  // required or optional
  std::optional<DeviceInfo> info;     // none: it has not answered yet
};
struct LateRow {  // samples that came after this record's slot was closed: in no record
  std::int64_t index = 0;
  PerSensor<std::uint64_t> samples{};
};
// A record's row: its data stand last, so that the other columns are read without them.
struct Blobs {
  ByteView spd, radar;    // u32 LE counts, zone after zone; f32 LE
  ByteView array, depth;  // pack_array(); deflated u16 LE, millimetres
};
struct StoredRecord {
  FusedRecord record;
  Blobs blobs;
};

void columns(Row& row, RunInfo& info);
void columns(Row& row, DeviceRow& device);
void columns(Row& row, CalibrationEntry& entry);
void columns(Row& row, Axis& axis);
void columns(Row& row, Antenna& antenna);
void columns(Row& row, Zone& zone);
void columns(Row& row, Anchor& anchor);
void columns(Row& row, Counted& counted);
void columns(Row& row, Event& event);
void columns(Row& row, LateRow& late);
void columns(Row& row, FusedRecord& record);  // all but its data
void columns(Row& row, Blobs& blobs);
void columns(Row& row, StoredRecord& stored);

// The table of a type, with all its columns.
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

// Tables of every run. A run of a detector with zones has the table zone as well.
const std::vector<const Row*>& tables();

// Runs an INSERT of a row whose columns these are in turn.
template <class... T>
void insert(Statement& statement, const T&... parts) {
  Row row(statement, Row::Does::write);
  (columns(row, const_cast<T&>(parts)), ...);  // which leaves them alone
  statement.run();
}
// Adds one row; `conflict`: what SQLite does if its key is there already.
template <class T>
void insert(sqlite3* db, const std::string& path, const T& row, const std::string& conflict = {}) {
  Statement statement(db, path, (table_of<T>().insert() + conflict).c_str());
  insert(statement, row);
}

// Takes the row that a SELECT of table_of<T>() stands at; returns what is wrong with it, or
// nothing.
template <class T>
std::string take(Statement& statement, T& value) {
  Row row(statement, Row::Does::read);
  columns(row, value);
  return row.fault();
}

}  // namespace echofuse::record
