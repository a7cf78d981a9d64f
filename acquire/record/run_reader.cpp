// SPDX-License-Identifier: MIT
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include "acquire/record/half_read.hpp"
#include "acquire/record/network.hpp"
#include "acquire/record/read_rows.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/run_tables.hpp"
#include "acquire/record/schema.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/writer_lock.hpp"

namespace echofuse::record {
namespace {

std::int64_t pragma(sqlite3* db, const std::string& path, const char* sql) {
  Statement s(db, path, sql);
  return s.step() ? s.integer() : 0;
}

Sensor sensor_of(const std::string& name, const std::string& path) {
  for (const Sensor s : {Sensor::spd, Sensor::radar, Sensor::depth})
    if (name == name_of(s)) return s;
  throw Error(ExitCode::failed, printable(path) + ": damaged: a row of sensor \"" +
                                    printable(name, 40) + "\"; expected spd, radar or depth");
}

constexpr std::int64_t most_points = 1 << 24;

std::string short_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

std::uint64_t bytes_of(const std::string& path) {
  struct stat file {};
  return ::stat(path.c_str(), &file) == 0 ? static_cast<std::uint64_t>(file.st_size) : 0;
}

bool is_there(const std::string& path) { return ::access(path.c_str(), F_OK) == 0; }

int look(sqlite3* db) {
  return sqlite3_exec(db, "SELECT 1 FROM sqlite_schema", nullptr, nullptr, nullptr);
}

}  // namespace

RunReader::RunReader(const std::string& path) : RunReader(path, network_of(path)) {}

RunReader::RunReader(const std::string& path, const std::string& network)
    : path_(path), shown_(printable(path)), budget_(std::make_unique<Budget>()) {
  if (::access(path.c_str(), R_OK) != 0)
    throw Error(ExitCode::failed, shown_ + ": " + std::strerror(errno) + "; expected a run file");
  require_regular_files(path);
  bytes_ = bytes_of(path) + bytes_of(path + "-wal");
  *budget_ = Budget::of_file(bytes_);
  try {
    open(network);
    check_identity();
    check_tables(db_, path_);
  } catch (...) {
    sqlite3_close(db_);
    throw;
  }
}

void RunReader::open(const std::string& network) {
  const auto try_to_open = [&](const std::string& name, int flags) {
    sqlite3_close(db_);
    db_ = nullptr;
    const int code = sqlite3_open_v2(name.c_str(), &db_, flags | SQLITE_OPEN_NOMUTEX, nullptr);
    if (code != SQLITE_OK) return code;
    refuse_foreign_wal(db_, path_);
    lacks_wal_ = journal_version(db_) == 2 && !is_there(path_ + "-wal") &&
                 bytes_of(path_ + "-journal") == 0 && !WriterLock::someone_writes(path_);
    harden(db_);
    limit(db_, *budget_);
    return lacks_wal_ && flags == SQLITE_OPEN_READONLY ? SQLITE_CANTOPEN : look(db_);
  };
  const auto unchanging = [&] {
    std::string uri = "file:";
    for (const char c : path_)
      uri += c == '%' ? "%25" : c == '?' ? "%3f" : c == '#' ? "%23" : std::string(1, c);
    uri += "?immutable=1";
    try_to_open(uri, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI);
  };
  if (!network.empty()) {
    require_closed(path_, network);
    return unchanging();
  }
  // Read-only, but a WAL left by a live or crashed writer needs its shared-memory file beside it.
  // Without a WAL or on a read-only medium there is no writer, and `immutable` reads without one.
  int code = try_to_open(path_, SQLITE_OPEN_READONLY);
  // Killed as it began or closed, with one page half written: a writer has to undo that.
  if (code == SQLITE_READONLY) code = try_to_open(path_, SQLITE_OPEN_READWRITE);
  if (code == SQLITE_CANTOPEN || code == SQLITE_READONLY) {
    // There it would hide the records in a WAL, and what undoes a half written page.
    for (const char* beside : {"-wal", "-journal"})
      if (bytes_of(path_ + beside) > 0)
        throw Error(ExitCode::failed, shown_ + ": was not closed, and its last records are in " +
                                          shown_ + beside +
                                          "; copy both to a folder that can be written");
    unchanging();
  }
  sqlite3_busy_timeout(db_, 5000);
}

void RunReader::check_identity() const {
  const int code = look(db_);
  if (code == SQLITE_BUSY || code == SQLITE_LOCKED)
    throw Error(ExitCode::failed, shown_ + ": is busy: another program holds it; try again");
  if (code == SQLITE_IOERR || code == SQLITE_CANTOPEN || code == SQLITE_NOMEM)
    throw Error(ExitCode::failed, shown_ + ": cannot be read: " + sqlite3_errmsg(db_));
  if (code == SQLITE_OK && pragma(db_, path_, "SELECT count(*) FROM sqlite_schema") == 0)
    throw Error(ExitCode::failed,
                shown_ + ": is empty: its run was killed before it began, or its records were in " +
                    shown_ + "-wal, which is not there; look for a copy named *.rescued.sqlite");
  if (code != SQLITE_OK || pragma(db_, path_, "PRAGMA application_id") != application_id)
    throw Error(ExitCode::failed, shown_ + ": not an echofuse run file");
  const auto found = pragma(db_, path_, "PRAGMA user_version");
  if (found > format_version)
    throw Error(ExitCode::failed, shown_ + ": run format " + std::to_string(found) +
                                      " is newer than this program's " +
                                      std::to_string(format_version) + "; use a newer echofuse");
}

Statement RunReader::ask(const char* sql) const {
  budget_->left = budget_->all;
  return {db_, path_, sql, budget_->bytes};
}

RunReader::~RunReader() { sqlite3_close(db_); }

RunInfo RunReader::info() const {
  Statement s =
      ask("SELECT uuid, started_utc, ended_utc, status, config_text, config_resolved, "
          "radar_cfg, version, host, operator, notes, window_s FROM run");
  RunInfo info;
  if (!s.step()) throw Error(ExitCode::failed, shown_ + ": the run table is empty");
  for (std::string* text : {&info.uuid, &info.started_utc, &info.ended_utc, &info.status,
                            &info.config_text, &info.config_resolved, &info.radar_cfg,
                            &info.version, &info.host, &info.operator_name, &info.notes})
    *text = s.text();
  info.window_s = s.real();
  if (has_table("meta")) {
    Statement rows = ask("SELECT key, value FROM meta");
    while (rows.step()) {
      const std::string key = rows.text();
      info.meta.emplace_back(key, rows.text());
    }
  }
  if (has_table("part")) {
    Statement first = ask("SELECT first_idx FROM part WHERE part = 0");
    if (first.step())
      info.first_index = std::clamp<std::int64_t>(first.integer(), 0, max_resumed_index);
  }
  if (info.status == "open" && !WriterLock::someone_writes(path_))
    info.status = lacks_wal_ ? crashed_without_wal : "crashed";
  return info;
}

std::vector<DeviceInfo> RunReader::devices() const {
  Statement s = ask("SELECT sensor, address, model, serial, firmware FROM device");
  std::vector<DeviceInfo> out;
  while (s.step()) {
    DeviceInfo d;
    d.sensor = sensor_of(s.text(), path_);
    for (std::string* text : {&d.address, &d.model, &d.serial, &d.firmware}) *text = s.text();
    out.push_back(std::move(d));
  }
  return out;
}

std::vector<CalibrationEntry> RunReader::calibrations() const {
  Statement s =
      ask("SELECT sensor, date_utc, method, distance_m, offset_m, standard_error_m FROM "
          "calibration");
  std::vector<CalibrationEntry> out;
  while (s.step()) {
    CalibrationEntry c;
    c.sensor = sensor_of(s.text(), path_);
    for (const CalibrationEntry& other : out)
      if (other.sensor == c.sensor)
        throw Error(ExitCode::failed,
                    shown_ + ": damaged: two calibrations of the " + name_of(c.sensor));
    c.date_utc = s.text();
    c.method = s.text();
    for (double* v : {&c.distance_m, &c.offset_m, &c.standard_error_m}) *v = s.real();
    out.push_back(std::move(c));
  }
  return out;
}

std::map<std::string, std::string> RunReader::policies() const {
  Statement s = ask("SELECT sensor, policy FROM policy");
  std::map<std::string, std::string> out;
  while (s.step()) {
    const std::string sensor = s.text();
    out[sensor] = s.text();
  }
  return out;
}

std::vector<Anchor> RunReader::anchors() const {
  Statement s = ask("SELECT mono_ns, utc_ns FROM anchor ORDER BY rowid");
  std::vector<Anchor> out;
  while (s.step()) {
    const HostTime mono(s.integer());
    out.push_back({mono, UtcTime(s.integer())});
  }
  return out;
}

std::vector<Event> RunReader::events() const {
  Statement s = ask("SELECT utc, level, source, text FROM event ORDER BY id");
  return read_events(s);
}

std::vector<Counted> RunReader::counters() const {
  std::vector<Counted> out;
  const auto columns = pragma(db_, path_, "SELECT count(*) FROM pragma_table_info('counter')");
  if (columns == 0) return out;
  const char* part = columns > 3 ? "part" : "0";
  const std::string sql = std::string("SELECT source, name, value, ") + part + " FROM counter";
  Statement s = ask(sql.c_str());
  while (s.step()) {
    Counted c;
    c.source = s.text();
    c.name = s.text();
    c.value = static_cast<std::uint64_t>(s.integer());
    c.part = s.integer();
    out.push_back(std::move(c));
  }
  return out;
}

std::vector<Axis> RunReader::axes() const {
  Statement s = ask("SELECT name, quantity, unit, count, start, step, scale FROM axis");
  constexpr std::size_t most_axes = 16;
  std::vector<Axis> out;
  while (s.step()) {
    if (out.size() == most_axes)
      throw Error(ExitCode::failed, shown_ + ": more than 16 axes; expected six");
    Axis a;
    a.name = s.text();
    a.quantity = s.text();
    a.unit = s.text();
    const std::int64_t points = s.integer();
    a.count = static_cast<std::uint32_t>(points);
    a.start = s.real();
    a.step = s.real();
    a.scale = s.real();
    check_axis(a, points);
    out.push_back(std::move(a));
  }
  return out;
}

// What readers hold for all records is made by the axes: a small file asks for a little only.
void RunReader::check_axis(const Axis& axis, std::int64_t points) const {
  const auto refuse = [&](const std::string& what) {
    throw Error(ExitCode::failed, shown_ + ": axis " + printable(axis.name, 40) + ": " + what);
  };
  if (points < 0 || points > most_points)
    refuse("has " + std::to_string(points) + " points; expected at most " +
           std::to_string(most_points));
  const auto is_length = [](double v) { return std::abs(v) < 1e15; };
  if (!is_length(axis.start) || !is_length(axis.step) || std::abs(axis.step) < 1e-15 ||
      !is_length(axis.scale) || !(axis.scale > 0))
    refuse("its start, step and scale are " + short_text(axis.start) + ", " +
           short_text(axis.step) + " and " + short_text(axis.scale) +
           "; expected numbers of a measurement");
  const double most = std::max(1e9, 256 * static_cast<double>(bytes_));
  // A map is as high as it is wide.
  double values = std::pow(static_cast<double>(points), axis.name == "map_x" ? 2 : 1);
  const std::size_t antennas = axis.name == "array" ? antennas_of(axis) : 1;
  if (antennas == 0) refuse("is of " + short_text(axis.scale) + " antennas; expected 1 to 12");
  if (axis.name == "array") values *= static_cast<double>(values_of_bin(antennas)) / 2;
  const auto too_many = [&](double records) { return 4 * values * records > most; };
  // Counting takes a while: only where the indices, which are quick to look up, make it doubtful.
  Statement s = ask("SELECT (SELECT min(idx) FROM record), (SELECT max(idx) FROM record)");
  s.step();
  const auto first = static_cast<double>(s.integer()), last = static_cast<double>(s.integer());
  if (too_many(last - first + 1) && too_many(static_cast<double>(count())))
    refuse(std::to_string(points) + " points in each of its records do not fit into " +
           std::to_string(bytes_) + " bytes of file");
}

std::optional<Axis> RunReader::axis(const std::string& name) const {
  for (auto& a : axes())
    if (a.name == name) return a;
  return std::nullopt;
}

// count(idx), not count(*): that walks through the pages without asking for the budget.
std::int64_t RunReader::count() const {
  Statement s = ask("SELECT count(idx) FROM record");
  return s.step() ? s.integer() : 0;
}

void RunReader::for_each(const std::function<bool(const FusedRecord&)>& visit, std::int64_t first,
                         const std::function<void(std::int64_t, const std::string&)>& on_bad,
                         SensorSet sensors, const InParallel& in_parallel) const {
  Statement row =
      ask(record_query({has_table("signal"), has_table("radar_array"), has_table("speckle"),
                        has_column(db_, path_, "speckle", "over_150_ms")})
              .c_str());
  row.bind(first);
  std::optional<Shapes> known;
  std::optional<std::int64_t> before;
  std::vector<HalfRead> some;
  // Returns whether more are wanted.
  const auto hand_over = [&] {
    const auto decode_one = [&](std::size_t i) { some[i].decode_depth(*known); };
    if (in_parallel && some.size() > 1)
      in_parallel(some.size(), decode_one);
    else
      for (std::size_t i = 0; i < some.size(); ++i) decode_one(i);
    for (const HalfRead& one : std::exchange(some, {})) {
      const std::int64_t index = one.record.index;
      if (!one.fault.empty() && !on_bad)
        throw Error(ExitCode::failed,
                    shown_ + ": record " + std::to_string(index) + ": " + one.fault);
      if (!one.fault.empty()) on_bad(index, one.fault);
      if (one.fault.empty() && !visit(one.record)) return false;
    }
    return true;
  };
  // What is wrong with the file comes after the records before it.
  const auto step = [&] {
    try {
      return row.step();
    } catch (const Error&) {
      if (!hand_over()) return false;
      throw;
    }
  };
  while (step()) {
    // Read while the records are, so that a live run's new axis is not missed by its first record.
    if (!known) known.emplace(axes());
    HalfRead one;
    one.read(row, *known, sensors);
    const std::int64_t index = one.record.index;
    if (index < first || index > max_index || (before && index <= *before)) {
      if (!hand_over()) return;
      throw Error(ExitCode::failed, shown_ + ": damaged: a record has the index " +
                                        std::to_string(index) + ", after " +
                                        (before ? std::to_string(*before) : "none"));
    }
    before = index;
    some.push_back(std::move(one));
    if (some.size() >= (in_parallel ? known->records_at_once() : 1) && !hand_over()) return;
  }
  hand_over();
}

FusedRecord RunReader::read(std::int64_t index) const {
  FusedRecord found;
  bool seen = false;
  for_each(
      [&](const FusedRecord& r) {
        seen = r.index == index;
        found = r;
        return false;
      },
      index);
  if (!seen)
    throw Error(ExitCode::failed, shown_ + ": no record " + std::to_string(index) + "; it has " +
                                      std::to_string(count()));
  return found;
}

}  // namespace echofuse::record
