// SPDX-License-Identifier: MIT
// Tables of a run file, format 3. One function describes a row: columns(Row&, T&). CREATE TABLE,
// INSERT and SELECT are generated from it. Times: *_ns are host monotonic nanoseconds, *_utc_ns
// those of UTC, utc is ISO 8601. NULL: unknown, or the sensor is missing.
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

// Visits the columns of a row in order, to list them, to bind them to an INSERT, or to read them
// from a SELECT. Changes values only when reading.
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
  void operator()(std::string_view name, Sensor& value);     // name of the sensor
  void operator()(std::string_view name, SensorSet& value);  // as bits
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
  // First invalid value of a row read; empty if all are valid.
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
  bool absent_ = false, seen_ = false;  // group: has no value; has a non-NULL column
  std::string fault_, table_, names_, declared_, values_;
};

// Rows without a type of their own in the measurement.
struct DeviceRow {
  Sensor sensor{};
  std::optional<std::string> policy;  // required or optional
  std::optional<DeviceInfo> info;     // no value: the device has not answered yet
};
struct LateRow {  // samples received after this record's slot was closed; they are in no record
  std::int64_t index = 0;
  PerSensor<std::uint64_t> samples{};
};
// Row of a record. The data come last, so that other columns are read without them.
struct Blobs {
  ByteView spd, radar;    // u32 LE counts, zone by zone; f32 LE
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
void columns(Row& row, CounterRow& counted);
void columns(Row& row, Event& event);
void columns(Row& row, LateRow& late);
void columns(Row& row, FusedRecord& record);  // all columns except the data
void columns(Row& row, Blobs& blobs);
void columns(Row& row, StoredRecord& stored);

// Returns the table of a type, with all its columns.
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

// Tables of every run. Runs of a detector with zones also have the table zone.
const std::vector<const Row*>& tables();

// Binds the columns of a row to an INSERT, in order, and runs it.
template <class... T>
void insert(Statement& statement, const T&... parts) {
  Row row(statement, Row::Purpose::write);
  (columns(row, const_cast<T&>(parts)), ...);  // leaves them unchanged
  statement.run();
}
// Inserts a row; `conflict`: SQLite's action if its key exists.
template <class T>
void insert(sqlite3* db, const std::string& path, const T& row, const std::string& conflict = {}) {
  Statement statement(db, path, (table_of<T>().insert() + conflict).c_str());
  insert(statement, row);
}

// Reads the row at which a SELECT of table_of<T>() is positioned; returns its fault, or nothing.
template <class T>
std::string take(Statement& statement, T& value) {
  Row row(statement, Row::Purpose::read);
  columns(row, value);
  return row.fault();
}

}  // namespace echofuse::record
