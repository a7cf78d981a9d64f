// SPDX-License-Identifier: MIT
// Reads a run file (run_writer.hpp).
#pragma once
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/fused_record.hpp"

struct sqlite3;

namespace echofuse::record {

class Statement;
struct Budget;

struct Event {
  std::string utc, level, source, text;
  std::optional<std::int64_t> id = {};  // assigned by SQLite in the order of the events
};

struct Anchor {  // the same moment on the monotonic clock and in UTC
  HostTime mono{};
  UtcTime utc{};
};

// Statistics of a run that can be computed without reading the sensor data.
struct RunSummary {
  // all_valid: number of records with valid data of all three sensors.
  std::int64_t records = 0, all_valid = 0;
  std::int64_t incomplete = 0;      // number of records in which a required sensor is missing
  PerSensor<std::int64_t> valid{};  // number of records with valid data of the sensor
  PerSensor<std::int64_t> lost{};   // number of lost tags, radar frames and depth frames
  std::int64_t tags = 0;
  // Number of records with antenna data; number of frames in these records.
  std::int64_t arrays = 0, array_frames = 0;
  std::int64_t last_index = -1;     // largest index of a record; -1 if there are no records
  UtcTime first_utc{}, last_utc{};  // start of the first slot; end of the last slot
  // Number of records by label; number of events by level.
  std::map<std::string, std::int64_t> labels, events;
  std::map<std::string, std::string> policies;  // "required" or "optional" for each sensor
  VerdictCounts verdicts;
  PerSensor<std::optional<ClockState>> clocks;  // clock fits of the last record that contains any
};

// Status of an unclosed run that lacks the -wal with its last records. Usually the file is an
// incomplete copy. The status is the same if the recording process was killed while it was starting
// the run.
inline constexpr const char* crashed_without_wal = "crashed, no -wal";
// Status of a copy that SQLite made of an open run (VACUUM INTO). The copy is a closed file and
// contains the records up to the time of copying.
inline constexpr const char* copy_of_open = "copy of an open run";

// Description of a run, without which the values of its records have no meaning.
struct RunHead {
  std::string path;
  RunInfo info;
  std::vector<Axis> axes;
  Antennas antennas;
  std::vector<CalibrationEntry> calibrations;

  std::optional<Axis> axis(const std::string& name) const;
};

// Reads closed, live and crashed runs. Threading: one thread at a time.
class RunReader {
 public:
  // Throws Error(failed) if the file is missing, damaged, of another format or not a run file. Also
  // throws Error(failed) if the file contains anything other than the tables of a run. The time and
  // memory for reading are limited; the limits depend on the size of the file. A closed run does
  // not change, so side files of SQLite are ignored. On a network file system, only closed runs can
  // be read.
  explicit RunReader(const std::string& path);
  // `network` is the result of network_of(path).
  RunReader(const std::string& path, const std::string& network);
  ~RunReader();
  RunReader(const RunReader&) = delete;
  RunReader& operator=(const RunReader&) = delete;

  const std::string& path() const { return path_; }
  bool closed() const { return closed_; }  // true if the run no longer changes
  // Returns SQLite's side files next to a closed run; they are ignored.
  std::vector<std::string> leftovers() const;
  // Returns the row of the table `run`. If the status is "open" but no process is writing the run,
  // the status is replaced by "crashed", `crashed_without_wal` or `copy_of_open`.
  RunInfo info() const;
  // Reads the description again only if the file has changed since the last call.
  std::shared_ptr<const RunHead> head() const;
  std::vector<DeviceInfo> devices() const;
  std::map<std::string, std::string> policies() const;  // "required" or "optional" by sensor
  std::vector<Anchor> anchors() const;
  std::vector<CalibrationEntry> calibrations() const;
  Antennas antennas() const;  // empty if the radar sent no antenna samples
  std::vector<Event> events() const;
  std::vector<Event> last_events(
      std::size_t max_count) const;  // the last `max_count` events, oldest first
  std::vector<CounterRow> counters() const;
  std::vector<Axis> axes() const;
  std::optional<Axis> axis(const std::string& name) const;
  std::int64_t count() const;
  RunSummary summary() const;
  // Returns the records from index `first` on, in order, but without the sensor data.
  std::vector<FusedRecord> outlines(std::int64_t first) const;
  // Returns how many tags, radar frames and depth frames were received after their slot was closed.
  PerSensor<std::int64_t> late() const;
  // Calls `visit` for the records from index `first` on, in order, until it returns false. A record
  // with data of a wrong size or non-finite values is skipped after a call of `on_bad`. If `on_bad`
  // is empty, Error is thrown with the index of the record. Only the data of the sensors in
  // `sensors` are decoded; all other sensors are marked as not valid. in_parallel(n, work) must
  // call work(0) ... work(n - 1) in any order, possibly on several threads; work(i) decodes a
  // record. `visit` and `on_bad` are still called in order on this thread.
  using InParallel = std::function<void(std::size_t, const std::function<void(std::size_t)>&)>;
  void for_each(const std::function<bool(const FusedRecord&)>& visit, std::int64_t first = 0,
                const std::function<void(std::int64_t, const std::string&)>& on_bad = {},
                SensorSet sensors = {Sensor::spd, Sensor::radar, Sensor::depth},
                const InParallel& in_parallel = {}) const;
  // Throws Error if the record is damaged, or CausedError(not_found) if it does not exist.
  FusedRecord read(std::int64_t index) const;
  // Reads everything except the values of the samples. Throws Error(failed) at the first fault.
  void read_all() const {
    info(), devices(), policies(), anchors(), calibrations(), antennas(), events(), counters();
    axes(), summary();
    for_each([](const FusedRecord&) { return true; }, 0, {}, {});
  }
  // Runs SQLite's integrity check. Returns its errors; empty if the file is undamaged.
  std::string check() const;

 private:
  struct Layout;
  Layout& layout() const;
  void open(const std::string& network);
  void check_axis(const Axis& axis) const;
  Zones zones() const;
  // Prepares a statement and resets its budget of instructions and bytes.
  Statement ask(const std::string& sql) const;
  std::vector<FusedRecord> records(const std::string& which) const;
  template <class T>
  // `tail` is the end of the SELECT statement, e.g. its WHERE clause.
  std::vector<T> rows(const std::string& tail = {}) const;
  std::string path_, file_, shown_;  // path as given, path with links resolved, path for messages
  sqlite3* db_ = nullptr;
  bool closed_ = false;      // result of is_closed()
  bool lacks_wal_ = false;   // true if no process writes the run and its -wal is missing or empty
  std::uint64_t bytes_ = 0;  // total size of the file and its -wal when they were opened
  std::unique_ptr<Budget> budget_;
  // Kept, because preparing the statement and reading the axes take ten times as long as reading a
  // record.
  mutable std::unique_ptr<Statement> record_;
  mutable std::unique_ptr<Layout> layout_;
};

}  // namespace echofuse::record
