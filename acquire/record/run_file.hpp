// SPDX-License-Identifier: MIT
// Run file: an SQLite database (WAL, synchronous=FULL) with one transaction per append. Committed
// records survive kill -9, power loss and a full disk. The file can be read while it is written.
//   PRAGMA application_id = 0x4543464d ("ECFM"), user_version = 4
//   tables: see rows.hpp; data columns of the table record: see columns.hpp
#pragma once
#include <atomic>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/fused_record.hpp"

struct sqlite3;

namespace echofuse::record {

class FileWatch;
class Statement;
struct WriterLock;
struct Budget;

inline constexpr int application_id = 0x4543464d;  // "ECFM" in ASCII
inline constexpr int format_version = 4;
// Largest allowed index of a record, chosen so that index + 1 cannot overflow.
inline constexpr std::int64_t max_index = std::int64_t{1} << 53;

struct CounterRow {
  std::string source, name;  // source: a sensor or "run"
  std::uint64_t value = 0;
};

// Times in ns (CLOCK_MONOTONIC) of a writer that waits for another program's write transaction.
// Threading: any thread.
struct LockWait {
  std::atomic<std::int64_t> give_up_ns = std::numeric_limits<std::int64_t>::max();
  std::atomic<std::int64_t> waited_ns = 0;  // last time at which a writer was waiting
  bool tried() const;  // Returns true if a writer was waiting within the last 100 ms.
};

// Writes a run file. Threading: one thread at a time. Every member throws Error, with the code
// `disk` if the disk is full or a write fails, otherwise with the code `failed`. A failed append
// leaves the file unchanged. Every member first checks that the file still exists and is undamaged;
// close() checks the whole file. If the check fails, the member throws Error(disk). close() then
// also copies the committed records to another file. The Error contains the path of that file.
class RunWriter {
 public:
  // Throws if the path exists. Creates a UUID if `info` does not contain one. `clock` supplies the
  // start and end times and must outlive the writer. The file appears at `path` after `begin` has
  // written its rows. If the process is killed earlier, PATH-new remains until the next writer
  // removes it.
  using Begin = std::function<void(RunWriter&)>;
  RunWriter(const std::string& path, const RunInfo& info, const Clock& clock = system_clock,
            const Begin& begin = {});
  // If close() was not called, the status remains "open", and readers report the run as crashed.
  ~RunWriter();
  RunWriter(const RunWriter&) = delete;
  RunWriter& operator=(const RunWriter&) = delete;

  // Must be called once per axis name, before the first record that uses the axis.
  void put_axis(const Axis& axis);
  void put_device(const DeviceInfo& device);    // adds a row; called each time a device answers
  void put_antennas(const Antennas& antennas);  // replaces the previously stored antennas
  void put_calibration(const CalibrationEntry& entry);
  void put_policy(Sensor sensor, const std::string& policy);  // policy is "required" or "optional"
  void put_anchor(HostTime mono, UtcTime utc);
  // Writes all counters in one transaction. Must be called at the end of the run.
  void put_counters(std::span<const CounterRow> counters);
  // Adds the late samples to the counts of their records, in one transaction.
  void put_late(const LateCounts& late);
  void put_event(UtcTime utc, Severity severity, const std::string& source,
                 const std::string& text);
  void append(const FusedRecord& record);
  // Returns the last label that put_label() wrote since the previous call and before the time
  // `before`, if any. After close(), returns the last label that was written before closing.
  std::optional<std::string> new_label(UtcTime before);
  // Appends all records in one transaction; for simulated data sets.
  void append(std::span<const FusedRecord> batch);
  // Stores the status and copies all data into the database, so that the file at `path` is complete
  // although its WAL still exists. Fast; close() must follow. From then on, another program may
  // move the file. Does nothing if another program holds a write transaction.
  void complete(const std::string& status);
  // Stores the status and merges the WAL into the database, so that only one file remains. Returns
  // false if another program is still reading the run after half a second. The last records then
  // remain in the WAL until recover() or a writer merges them. Throws Error(failed) at the end if
  // another program added tables, because readers would reject the file. `unwritten`: number of
  // records that could not be written, stored in an event and in the counter run/unwritten.
  bool close(const std::string& status, std::int64_t unwritten = 0);
  // Removes the file instead of closing it. Must be called before the first record.
  void discard();
  // Like close(), but throws Error(failed) instead of returning false.
  void close_as_one_file(const std::string& status);
  // Returns true if the last call found the file missing or damaged.
  bool lost() const { return !harm_.empty(); }
  // Reserves disk space again, so that the status can be written even if the disk is full.
  void reserve() const;

  // Makes the writer wait for another program's write transaction until `patience.give_up_ns`,
  // instead of at most 30 s. After that time, the waiting call throws Error(disk). `patience` must
  // outlive the writer.
  void wait_with(LockWait& lock_wait) { lock_wait_ = &lock_wait; }
  const std::string& path() const { return path_; }
  std::int64_t records() const { return records_; }

 private:
  void lock();
  void open(const std::string& path);
  void make(const RunInfo& info, const Begin& begin);
  void begin_writing();
  void use_wal();
  void ready();
  void in_transaction(const std::function<void()>& body);
  bool checkpoint();
  void require_sound();
  void require_whole();
  void throw_harm() const;
  bool fold();
  bool waits_on(int tries);
  void wait_for_others();
  void put_unwritten(std::int64_t records);
  [[noreturn]] void leave(const std::string& status);
  std::string path_;
  const Clock& clock_;
  std::unique_ptr<WriterLock> lock_;
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> handle_;
  sqlite3* db_ = nullptr;
  std::unique_ptr<FileWatch> watch_;
  std::string completed_;  // status stored by complete(), if the database contains all data
  bool touched_ = false;   // another program wrote to the file before this writer's checkpoint
  std::string harm_;       // error message if the file is missing or damaged
  LockWait* lock_wait_ = nullptr;
  std::int64_t waits_since_ns_ = 0;
  std::optional<std::string> left_label_;  // last label before the run was closed
  std::vector<Axis> axes_;
  std::int64_t records_ = 0, last_event_ = 0;
};

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

struct RecordShapes;

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
  RunHead head() const;
  std::vector<DeviceInfo> devices() const;
  std::map<std::string, std::string> policies() const;  // "required" or "optional" by sensor
  std::vector<Anchor> anchors() const;
  std::vector<CalibrationEntry> calibrations() const;
  Antennas antennas() const;  // empty if the radar sent no antenna samples
  std::vector<Event> events() const;
  std::vector<Event> last_events(std::size_t most) const;  // the last `most` events, oldest first
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
  // Kept by read(), because preparing the statement and reading the axes take ten times as long as
  // reading a record.
  mutable std::unique_ptr<Statement> record_;
  mutable std::unique_ptr<const RecordShapes> shapes_;
};

// Adds an event of level "note" to a run; `who` is the source of the event. An open run is changed
// by a transaction. A closed run is locked and replaced by a copy that contains the note and has
// the same mode and owner. Throws Error(disk) if the disk does not have enough space for the copy,
// and Error(failed) if the -wal of the run is missing.
void put_note(const std::string& path, const std::string& text, const std::string& who);
// Adds an event of level "label". The recording process uses this label for all records from the
// current slot on. Throws Error(failed) if the run is not being recorded.
void put_label(const std::string& path, const std::string& label, const std::string& who);

// Changes the status of a crashed run from "open" to "crashed" and merges its WAL. Does nothing if
// the file is not a run or is damaged, not writable or in use by another program.
void recover(const std::string& path);

}  // namespace echofuse::record
