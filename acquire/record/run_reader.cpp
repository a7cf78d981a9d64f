// SPDX-License-Identifier: MIT
#include "acquire/record/run_reader.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <utility>

#include "acquire/record/network_file_system.hpp"
#include "acquire/record/rows.hpp"
#include "acquire/record/run_guard.hpp"
#include "acquire/record/side_files.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/writer_lock.hpp"
#include "drivers/util/caused_error.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::record {

// Values that are read again if the file has changed.
struct RunReader::Layout {
  unsigned version = 0;  // SQLITE_FCNTL_DATA_VERSION
  Shapes shapes;
  std::shared_ptr<const RunHead> head;  // null until head() is called
};

namespace {

constexpr std::int64_t max_points = 1 << 24;
constexpr double max_offset_m = 1000;

Error bad_record(const std::string& run, std::int64_t index, const std::string& fault) {
  return {ExitCode::failed, run + ": record " + std::to_string(index) + ": " + fault};
}

std::uint64_t bytes_of(const std::string& path) {
  struct stat file {};
  return ::stat(path.c_str(), &file) == 0 ? static_cast<std::uint64_t>(file.st_size) : 0;
}

// Latest end of a slot: one year before UtcTime ends (2262), so that times up to a year later do
// not overflow.
constexpr UtcTime last_slot_end = UtcTime::max() - std::chrono::years(1);

// Returns an error message for invalid slot times. Sums and differences of valid times cannot
// overflow.
std::string fault_of_slot(const FusedRecord& r) {
  constexpr std::chrono::nanoseconds zero{0};
  const bool sound = r.slot_start >= zero && r.slot_end >= r.slot_start && r.slot_utc >= zero &&
                     r.slot_utc <= last_slot_end &&
                     r.slot_end - r.slot_start <= last_slot_end - r.slot_utc;
  if (sound) return {};
  return "its slot is from " + std::to_string(r.slot_start.count()) + " to " +
         std::to_string(r.slot_end.count()) + " ns and starts at " +
         std::to_string(r.slot_utc.count()) +
         " ns UTC; expected an end after the start, and years from 1970 to 2261";
}

// Returns how many records to unpack together: at most 64, and at most 16 M values.
std::size_t batch_size(const Shapes& shapes) {
  constexpr std::size_t max_batch = 64, max_values = std::size_t{1} << 24;
  std::size_t values = 1;
  for (const Shape& shape : shapes) values += shape.values;
  return std::clamp<std::size_t>(max_values / values, 1, max_batch);
}

// Reads the current row. The values of the record are not unpacked yet.
StoredRecord stored_record(Statement& row, SensorSet sensors) {
  StoredRecord out;
  out.fault = take(row, out);
  FusedRecord& r = out.record;
  r.valid = SensorSet::from_bits(r.valid.bits() & sensors.bits());
  if (out.fault.empty()) out.fault = fault_of_slot(r);
  if (const auto clicks = r.signal.clicks_per_pulse.value_or(0);
      out.fault.empty() && !(clicks >= 0 && clicks < 1e9))
    out.fault = "its number of clicks per laser pulse is not from 0 to 1e9";
  return out;
}

}  // namespace

RunReader::RunReader(const std::string& path) : RunReader(path, network_of(path)) {}

RunReader::RunReader(const std::string& path, const std::string& network)
    : path_(path),
      file_(real_path(path)),
      shown_(printable(path)),
      budget_(std::make_unique<Budget>()) {
  if (::access(path.c_str(), R_OK) != 0)
    throw CausedError(cause_of(errno),
                      shown_ + ": " + std::strerror(errno) + "; expected a run file");
  require_regular(path, ExitCode::failed);
  bytes_ = bytes_of(file_) + bytes_of(file_ + "-wal");
  *budget_ = Budget::of_file(bytes_);
  try {
    open(network);
    check_identity(db_, path_);
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
    harden(db_);
    limit(db_, *budget_);
    return lacks_wal_ && flags == SQLITE_OPEN_READONLY ? SQLITE_CANTOPEN : probe(db_);
  };
  const auto unchanging = [&] {
    try_to_open(immutable_uri(file_), SQLITE_OPEN_READONLY | SQLITE_OPEN_URI);
  };
  closed_ = is_closed(file_);
  if (closed_) return unchanging();
  require_regular_files(file_);
  if (!network.empty()) {
    require_closed(path_, network);
    return unchanging();
  }
  if (!WriterLock::someone_writes(file_)) {
    require_own_journal(file_);
    require_own_wal(file_);
    lacks_wal_ = lacks_wal(file_) && bytes_of(file_ + "-journal") == 0;
  }
  // Even a read-only connection needs a shared-memory file next to a WAL. Without a WAL, or on a
  // read-only medium, no process is writing, and an immutable connection needs no such file.
  int code = try_to_open(file_, SQLITE_OPEN_READONLY);
  // SQLITE_READONLY means that a writer was killed while starting or closing the run. Only a
  // writable connection can roll back the writer's transaction.
  if (code == SQLITE_READONLY) code = try_to_open(file_, SQLITE_OPEN_READWRITE);
  closed_ = journal_version(db_) == 1;  // the writer may have closed the run after is_closed()
  if (closed_) return unchanging();
  if (code == SQLITE_CANTOPEN || code == SQLITE_READONLY) {
    // An immutable connection would ignore the records in a WAL. It would also ignore a journal
    // that must be rolled back.
    for (const char* suffix : {"-wal", "-journal"})
      if (bytes_of(file_ + suffix) > 0 && !lacks_wal_)
        throw Error(ExitCode::failed, shown_ + ": was not closed, and its last records are in " +
                                          printable(file_) + suffix +
                                          "; copy both files to a writable folder");
    unchanging();
  }
  sqlite3_busy_timeout(db_, 5000);
}

std::vector<std::string> RunReader::leftovers() const {
  if (!closed_ || WriterLock::someone_writes(file_)) return {};
  return side_files(file_);
}

Statement RunReader::ask(const std::string& sql) const {
  budget_->left = budget_->all;
  return {db_, path_, sql.c_str(), budget_->bytes};
}

template <class T>
std::vector<T> RunReader::rows(const std::string& tail) const {
  const Row& table = table_of<T>();
  Statement row = ask(table.select() + tail);
  std::vector<T> out;
  while (row.step())
    if (const std::string fault = take(row, out.emplace_back()); !fault.empty())
      throw Error(ExitCode::failed, shown_ + ": damaged: table " + table.name() + ": " + fault);
  return out;
}

RunReader::~RunReader() {
  record_.reset();  // because SQLite does not close a database that has statements
  sqlite3_close(db_);
}

RunInfo RunReader::info() const {
  std::vector<RunInfo> found = rows<RunInfo>(" LIMIT 1");
  if (found.empty()) throw Error(ExitCode::failed, shown_ + ": the run table is empty");
  RunInfo& info = found.front();
  if (info.status != "open") return info;
  if (closed_)
    info.status = copy_of_open;
  else if (!WriterLock::someone_writes(file_))
    info.status = lacks_wal_ ? crashed_without_wal : "crashed";
  return info;
}

RunReader::Layout& RunReader::layout() const {
  Statement begun = ask("SELECT 1 FROM run");  // the version is that of the current transaction
  begun.step();
  unsigned version = 0;
  sqlite3_file_control(db_, "main", SQLITE_FCNTL_DATA_VERSION, &version);
  if (!layout_ || layout_->version != version)
    layout_.reset(new Layout{version, shapes_of(axes()), nullptr});
  return *layout_;
}

std::shared_ptr<const RunHead> RunReader::head() const {
  auto& head = layout().head;
  if (!head)
    head = std::make_shared<RunHead>(RunHead{path_, info(), axes(), antennas(), calibrations()});
  return head;
}

std::vector<DeviceInfo> RunReader::devices() const {
  std::vector<DeviceInfo> out;
  for (DeviceRow& row : rows<DeviceRow>())
    if (row.info) out.push_back(std::move(*row.info)), out.back().sensor = row.sensor;
  return out;
}

std::map<std::string, std::string> RunReader::policies() const {
  std::map<std::string, std::string> out;
  for (const DeviceRow& row : rows<DeviceRow>())
    if (row.policy) out[name_of(row.sensor)] = *row.policy;
  return out;
}

std::vector<CalibrationEntry> RunReader::calibrations() const {
  std::vector<CalibrationEntry> out = rows<CalibrationEntry>(" LIMIT 4");
  for (const CalibrationEntry& one : out)
    if (!(std::abs(one.offset_m) <= max_offset_m))
      throw Error(
          ExitCode::failed,
          shown_ + format(": damaged: the offset of sensor %s is %g m; expected at most %g m",
                          name_of(one.sensor), one.offset_m, max_offset_m));
  for (const CalibrationEntry& one : out)
    for (const CalibrationEntry& other : out)
      if (&one != &other && one.sensor == other.sensor)
        throw Error(ExitCode::failed, shown_ + ": damaged: contains two calibrations of sensor " +
                                          name_of(one.sensor));
  return out;
}

Antennas RunReader::antennas() const {
  Antennas out = rows<Antenna>(" ORDER BY rowid LIMIT " + std::to_string(max_antennas + 1));
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!out[i].plausible() || i == max_antennas)
      throw Error(ExitCode::failed,
                  shown_ + ": damaged: antenna " + std::to_string(i) +
                      " is not valid; expected at most 12 antennas with position, gain and phase");
  }
  const auto array = axis("array");
  if (array && !out.empty() && out.size() != antennas_of(*array))
    throw Error(ExitCode::failed, shown_ + ": damaged: " + std::to_string(out.size()) +
                                      " antennas, but its array axis has " +
                                      std::to_string(antennas_of(*array)));
  return out;
}

// A run of a single pixel has no table of zones. Checks the table definition, because a live run
// may create the table after check_tables().
Zones RunReader::zones() const {
  const Row& table = table_of<Zone>();
  Statement stored = ask("SELECT sql FROM sqlite_schema WHERE name = '" + table.name() + "'");
  if (!stored.step() || stored.text() != table.create()) return single_pixel();
  Zones out = rows<Zone>(" ORDER BY rowid LIMIT " + std::to_string(max_zones + 1));
  if (out.empty()) return single_pixel();
  if (out.size() > max_zones || !std::ranges::all_of(out, &Zone::plausible))
    throw Error(ExitCode::failed, shown_ + ": damaged: table zone: expected at most " +
                                      std::to_string(max_zones) +
                                      " zones, each with a centre, a width and a time-zero offset");
  return out;
}

std::vector<Anchor> RunReader::anchors() const { return rows<Anchor>(); }
std::vector<CounterRow> RunReader::counters() const { return rows<CounterRow>(); }
std::vector<Event> RunReader::events() const { return rows<Event>(" ORDER BY id"); }

std::vector<Event> RunReader::last_events(std::size_t max_count) const {
  std::vector<Event> out = rows<Event>(" ORDER BY id DESC LIMIT " + std::to_string(max_count));
  std::reverse(out.begin(), out.end());
  return out;
}

std::vector<Axis> RunReader::axes() const {
  constexpr std::size_t max_axes = 16;
  std::vector<Axis> out = rows<Axis>(" LIMIT " + std::to_string(max_axes + 1));
  if (out.size() > max_axes)
    throw Error(ExitCode::failed, shown_ + ": contains more than 16 axes; expected six");
  for (Axis& axis : out) {
    if (axis.name == "spd") axis.zones = zones();
    check_axis(axis);
  }
  return out;
}

// Throws if the data of all records on this axis would need more memory than the file size allows.
void RunReader::check_axis(const Axis& axis) const {
  const std::int64_t points = axis.count;
  const auto refuse = [&](const std::string& what) {
    throw Error(ExitCode::failed, shown_ + ": axis " + printable(axis.name, 40) + ": " + what);
  };
  if (points > max_points)
    refuse("has " + std::to_string(points) + " points; expected at most " +
           std::to_string(max_points));
  const auto is_length = [](double v) { return std::abs(v) < 1e15; };
  if (!is_length(axis.start) || !is_length(axis.step) || std::abs(axis.step) < 1e-15 ||
      !is_length(axis.scale) || !(axis.scale > 0))
    refuse(
        format("its start, step and scale are %g, %g and %g", axis.start, axis.step, axis.scale) +
        "; expected finite numbers, |step| of at least 1e-15, scale above 0");
  const double max_values = std::max(1e9, 256 * static_cast<double>(bytes_));
  // The size of axis `map_x` is both the width and the height of the map.
  double values = std::pow(static_cast<double>(axis.values()), axis.name == "map_x" ? 2 : 1);
  const std::size_t antennas = axis.name == "array" ? antennas_of(axis) : 1;
  if (antennas == 0) refuse(format("has %g antennas; expected 1 to 12", axis.scale));
  if (axis.name == "array") values *= static_cast<double>(values_of_bin(antennas)) / 2;
  const auto too_many = [&](double records) { return 4 * values * records > max_values; };
  // Checks the range of indices first, because counting the records takes more time.
  Statement s = ask("SELECT (SELECT min(idx) FROM record), (SELECT max(idx) FROM record)");
  s.step();
  const std::int64_t first = s.integer(), last = s.integer();
  if (first < 0 || last > max_index)
    throw Error(ExitCode::failed,
                shown_ + ": damaged: the record index " + std::to_string(first < 0 ? first : last) +
                    " is out of range; expected 0 to " + std::to_string(max_index));
  if (too_many(static_cast<double>(last - first + 1)) && too_many(static_cast<double>(count())))
    refuse(std::to_string(points) + " points per record do not fit into a file of " +
           std::to_string(bytes_) + " bytes");
}

std::optional<Axis> RunHead::axis(const std::string& name) const {
  const Axis* const found = find_axis(axes, name);
  return found ? std::optional(*found) : std::nullopt;
}

std::optional<Axis> RunReader::axis(const std::string& name) const {
  const std::vector<Axis> all = axes();
  const Axis* const found = find_axis(all, name);
  return found ? std::optional(*found) : std::nullopt;
}

// Uses count(idx), because count(*) reads pages without checking the budget.
std::int64_t RunReader::count() const {
  Statement s = ask("SELECT count(idx) FROM record");
  return s.step() ? s.integer() : 0;
}

void RunReader::for_each(const std::function<bool(const FusedRecord&)>& visit, std::int64_t first,
                         const std::function<void(std::int64_t, const std::string&)>& on_bad,
                         SensorSet sensors, const InParallel& in_parallel) const {
  Statement row = ask(table_of<StoredRecord>().select() + " WHERE idx >= ? ORDER BY idx");
  row.bind(first);
  std::optional<Shapes> known;
  std::optional<std::int64_t> before;
  std::vector<StoredRecord> some;
  // Unpacks the collected records and passes them to `visit`. Returns false if `visit` returned
  // false.
  const auto hand_over = [&] {
    const auto unpack_one = [&](std::size_t i) {
      if (some[i].fault.empty()) some[i].fault = unpack(some[i].blobs, *known, some[i].record);
    };
    if (in_parallel && some.size() > 1)
      in_parallel(some.size(), unpack_one);
    else
      for (std::size_t i = 0; i < some.size(); ++i) unpack_one(i);
    for (const StoredRecord& one : std::exchange(some, {})) {
      const std::int64_t index = one.record.index;
      if (!one.fault.empty() && !on_bad) throw bad_record(shown_, index, one.fault);
      if (!one.fault.empty()) on_bad(index, one.fault);
      if (one.fault.empty() && !visit(one.record)) return false;
    }
    return true;
  };
  // If the file is damaged, passes on the preceding records before throwing.
  const auto step = [&] {
    try {
      return row.step();
    } catch (const Error&) {
      if (!hand_over()) return false;
      throw;
    }
  };
  while (step()) {
    // Reads the axes after the first row, because the writer of a live run may add axes together
    // with the first record.
    if (!known) known = layout().shapes;
    StoredRecord one = stored_record(row, sensors);
    const std::int64_t index = one.record.index;
    if (index < first || index > max_index || (before && index <= *before)) {
      if (!hand_over()) return;
      throw Error(
          ExitCode::failed,
          shown_ + ": damaged: the record index " + std::to_string(index) +
              " is out of order; previous index: " + (before ? std::to_string(*before) : "none"));
    }
    before = index;
    some.push_back(std::move(one));
    if (some.size() >= (in_parallel ? batch_size(*known) : 1) && !hand_over()) return;
  }
  hand_over();
}

// Keeps the statement only if no error occurred, because a statement that has not been reset would
// keep the writer of a live run from merging its WAL.
FusedRecord RunReader::read(std::int64_t index) const {
  auto row = std::exchange(record_, nullptr);
  if (!row) row.reset(new Statement(ask(table_of<StoredRecord>().select() + " WHERE idx = ?")));
  budget_->left = budget_->all;
  row->restart(budget_->bytes);
  row->bind(index);
  if (!row->step())
    throw CausedError(Cause::not_found, shown_ + ": no record " + std::to_string(index) +
                                            "; number of records: " + std::to_string(count()));
  // Reads the axes after the row, because the next record of a live run may add an axis.
  const Shapes& shapes = layout().shapes;
  StoredRecord one = stored_record(*row, {Sensor::spd, Sensor::radar, Sensor::depth});
  if (one.fault.empty()) one.fault = unpack(one.blobs, shapes, one.record);
  if (!one.fault.empty()) throw bad_record(shown_, index, one.fault);
  row->restart();
  record_ = std::move(row);
  return std::move(one.record);
}

RunSummary RunReader::summary() const {
  RunSummary sum;
  Statement totals = ask(
      "SELECT count(idx), total(valid & 7 = 7), total(valid & 1), total(valid >> 1 & 1), "
      "total(valid >> 2 & 1), total(spd_lost), total(radar_lost), total(depth_lost), total(tags), "
      "total(missing > 0), count(array), total(iif(array IS NULL, 0, array_frames)), "
      "ifnull(max(idx), -1) FROM record");
  if (totals.step()) {
    sum.records = totals.integer();
    sum.all_valid = totals.integer();
    for (auto* three : {&sum.valid, &sum.lost})
      for (auto& n : *three) n = totals.integer();
    for (auto* n : {&sum.tags, &sum.incomplete, &sum.arrays, &sum.array_frames, &sum.last_index})
      *n = totals.integer();
  }
  // Finds the first and the last record by index instead of time, because the clock may have been
  // set back.
  const std::vector<FusedRecord> ends =
      records("idx IN ((SELECT min(idx) FROM record), (SELECT max(idx) FROM record))");
  if (!ends.empty()) {
    sum.first_utc = ends.front().slot_utc;
    sum.last_utc = ends.back().slot_utc + (ends.back().slot_end - ends.back().slot_start);
  }
  // Counts the rows in C++, because GROUP BY would make SQLite sort a copy of all rows.
  const auto count_by = [&](const char* sql, std::map<std::string, std::int64_t>& into) {
    Statement rows = ask(sql);
    while (rows.step()) ++into[rows.text()];
  };
  count_by("SELECT label FROM record", sum.labels);
  count_by("SELECT level FROM event", sum.events);
  Statement verdicts = ask("SELECT spd_verdict, radar_verdict, depth_verdict FROM record");
  while (verdicts.step()) {
    PerSensor<Verdict> of_record;
    for (Verdict& verdict : of_record) verdict.kind = kind_of(verdicts.text());
    sum.verdicts.add(of_record);
  }
  sum.policies = policies();
  for (const Sensor s : all_sensors) {
    const std::string samples = std::string(name_of(s)) + "_clock_samples";
    const auto last = records("idx = (SELECT max(idx) FROM record WHERE " + samples + " > 0)");
    if (!last.empty()) sum.clocks[s] = last.front().clocks[s];
  }
  return sum;
}

std::vector<FusedRecord> RunReader::records(const std::string& which) const {
  std::vector<FusedRecord> out;
  Statement row = ask(table_of<FusedRecord>().select() + " WHERE " + which + " ORDER BY idx");
  while (row.step()) {
    FusedRecord& r = out.emplace_back();
    static_cast<void>(take(row, r));  // invalid numbers are ignored
    if (const std::string fault = fault_of_slot(r); !fault.empty())
      throw bad_record(shown_, r.index, fault);
  }
  return out;
}

std::vector<FusedRecord> RunReader::outlines(std::int64_t first) const {
  return records("idx >= " + std::to_string(first));
}

PerSensor<std::int64_t> RunReader::late() const {
  PerSensor<std::int64_t> out{};
  Statement row = ask("SELECT total(spd), total(radar), total(depth) FROM late");
  if (row.step())
    for (auto& n : out) n = row.integer();
  return out;
}

std::string RunReader::check() const {
  Statement s = ask("PRAGMA integrity_check");
  const std::string answer = s.step() ? s.text() : "no answer";
  return answer == "ok" ? "" : answer;
}

}  // namespace echofuse::record
