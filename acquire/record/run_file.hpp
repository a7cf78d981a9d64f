// SPDX-License-Identifier: MIT
// Run file: one SQLite database (WAL, synchronous=FULL), one transaction per append. Survives
// kill -9, power loss and a full disk with every committed record. Can be read while it is written.
//   PRAGMA application_id = 0x4543464d ("ECFM"), user_version = 3
//   tables: rows.hpp; record.spd u32 LE counts [zones, bins] | radar f32 LE | depth u16 LE
//   millimetres, deflated
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
#include "drivers/core/zone.hpp"

struct sqlite3;

namespace echofuse::record {

class FileWatch;
class Statement;
struct WriterLock;
struct Budget;

inline constexpr int application_id = 0x4543464d;  // "ECFM"
inline constexpr int format_version = 3;
// Largest index of a record, so that index + 1 cannot overflow.
inline constexpr std::int64_t max_index = std::int64_t{1} << 53;

struct CounterRow {
  std::string source, name;  // sensor, name of the counter
  std::uint64_t value = 0;
};

// Waiting time of writers while another program holds a write transaction. CLOCK_MONOTONIC, ns.
// Threading: any thread.
struct Patience {
  std::atomic<std::int64_t> give_up_ns = std::numeric_limits<std::int64_t>::max();
  std::atomic<std::int64_t> waited_ns = 0;  // last wait of a writer
  bool tried() const;                       // true while a writer is waiting
};

// Threading: one thread at a time. Every member throws Error (disk for a full disk or a failed
// write, failed for anything else). A failed append leaves the file unchanged. Every member first
// checks that the file still exists, unchanged and sound; close() reads all of it. Otherwise they
// throw Error(disk), and close() rescues the committed records into a copy named in its Error.
class RunWriter {
 public:
  // Refuses a path that exists. Sets a missing uuid. `clock` must outlive the writer; it gives the
  // times of begin and end. The file is published when it contains the rows put by `begin`; kill -9
  // before that leaves PATH-new, which the next writer removes.
  using Begin = std::function<void(RunWriter&)>;
  RunWriter(const std::string& path, const RunInfo& info, const Clock& clock = system_clock,
            const Begin& begin = {});
  ~RunWriter();  // without close(): status remains "open", shown by readers as crashed
  RunWriter(const RunWriter&) = delete;
  RunWriter& operator=(const RunWriter&) = delete;

  // Call once per axis name, before the first record that needs it.
  void put_axis(const Axis& axis);
  void put_device(const DeviceInfo& device);    // adds a row if the sensor had answered before
  void put_antennas(const Antennas& antennas);  // replaces those of the array axis
  void put_zones(const Zones& zones);           // once, before the first record
  void put_calibration(const CalibrationEntry& entry);
  void put_policy(Sensor sensor, const std::string& policy);  // required or optional
  void put_anchor(HostTime mono, UtcTime utc);
  // Call at the end with all counters: one transaction.
  void put_counters(std::span<const CounterRow> counters);
  // Adds late samples to the counts of these records, in one transaction.
  void put_late(const LateCounts& late);
  void put_event(UtcTime utc, Severity severity, const std::string& source,
                 const std::string& text);
  void append(const FusedRecord& record);
  // Returns the last label written by put_label() since the last call and before this time, or
  // nothing. After close(): the last one written until then.
  std::optional<std::string> new_label(UtcTime before);
  void append(std::span<const FusedRecord> batch);  // one transaction; for simulated data sets
  // Folds the WAL back, which leaves a single file. Throws Error(failed) at the end if another
  // program added tables, because readers would refuse the file. Returns false if another program
  // is still reading the run after half a second; the last records then remain in the WAL until
  // recover() or a writer folds them back. `unwritten`: number of records that could not be
  // written, stated by an event and the counter run/unwritten.
  bool close(const std::string& status, std::int64_t unwritten = 0);
  void close_as_one_file(const std::string& status);  // like close(), but throws Error(failed)
                                                      // instead of returning false
  bool lost() const { return !harm_.empty(); }        // result of the last call
  // Reserves disk space again, so that the status can be written on a full disk.
  void reserve() const;

  // Sets the time limit for waiting while another program holds a write transaction: until
  // `patience` ends it, by default 30 s. Then the call throws Error(disk). `patience` must outlive
  // the writer.
  void wait_with(Patience& patience) { patience_ = &patience; }
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
  void checkpoint();
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
  bool touched_ = false;  // written by another program before our checkpoint
  std::string harm_;      // fault of the file
  Patience* patience_ = nullptr;
  std::int64_t waits_since_ns_ = 0;
  std::optional<std::string> left_label_;  // last label at the end
  std::vector<Axis> axes_;
  std::size_t histograms_ = 1;  // number per record
  std::int64_t records_ = 0, last_event_ = 0;
};

struct Event {
  std::string utc, level, source, text;
  std::optional<std::int64_t> id = {};  // set by SQLite, in the order of the events
};

struct Anchor {  // same moment on both clocks
  HostTime mono{};
  UtcTime utc{};
};

// Statistics of a run that do not need the sensors' data.
struct RunSummary {
  std::int64_t records = 0, all_valid = 0;  // all_valid: records with all three sensors
  std::int64_t incomplete = 0;              // records without a required sensor
  std::int64_t doubtful = 0;                // records with a verdict other than ok
  PerSensor<std::int64_t> valid{};          // records with a valid SPD, radar, depth
  PerSensor<std::int64_t> lost{};           // tags, radar frames, depth frames
  std::int64_t tags = 0;
  std::int64_t arrays = 0, array_frames = 0;           // records with antenna data; their frames
  std::int64_t last_index = -1;                        // largest index
  UtcTime first_utc{}, last_utc{};                     // start of the first slot, end of the last
  std::map<std::string, std::int64_t> labels, events;  // records by label, events by level
  std::map<std::string, std::string> policies;         // by sensor
  // Records by sensor and verdict, without the figures after a verdict's colon.
  PerSensor<std::map<std::string, std::int64_t>> verdicts;
  PerSensor<std::optional<ClockState>> clocks;  // from the last record that has them
};

// Returns e.g. "28 of 75 doubtful: radar missing 11, weak 10; camera frozen 7"; empty if all are
// ok.
std::string doubts_of(const RunSummary& sum);
// Returns a verdict without the figures after its colon.
std::string verdict_kind(const std::string& verdict);
// Counts one record's verdicts in `verdicts` and `doubtful`.
void count_verdicts(RunSummary& sum, const PerSensor<std::string>& verdicts);

// Status of a copy of an unclosed run without its -wal, which contains the last records. A run that
// was killed at its start looks the same.
inline constexpr const char* crashed_without_wal = "crashed, no -wal";
// Status of a copy made by SQLite of an open run (VACUUM INTO): a closed file with the records of
// that moment.
inline constexpr const char* copy_of_open = "copy of an open run";

// Reads closed, live and crashed runs. Threading: one thread at a time.
class RunReader {
 public:
  // Throws Error(failed) if the file is missing, not a run file, of another format, damaged, or
  // contains anything else than a run's tables. The file's size bounds the cost of reading it. A
  // closed run is immutable: side files of SQLite are not read. On a network file system only
  // closed runs are read.
  explicit RunReader(const std::string& path);
  RunReader(const std::string& path, const std::string& network);  // `network`: result of
                                                                   // network_of(path)
  ~RunReader();
  RunReader(const RunReader&) = delete;
  RunReader& operator=(const RunReader&) = delete;

  const std::string& path() const { return path_; }
  // SQLite's side files next to a closed run, which are ignored.
  std::vector<std::string> leftovers() const;
  // Changes status "open" to "crashed", crashed_without_wal or copy_of_open if no writer holds the
  // run.
  RunInfo info() const;
  std::vector<DeviceInfo> devices() const;
  std::map<std::string, std::string> policies() const;  // by sensor
  std::vector<Anchor> anchors() const;
  std::vector<CalibrationEntry> calibrations() const;
  Antennas antennas() const;  // empty if the radar sent no antenna samples
  Zones zones() const;        // empty for a single pixel
  std::vector<Event> events() const;
  std::vector<Event> last_events(std::size_t most) const;  // oldest first
  std::vector<CounterRow> counters() const;
  std::vector<Axis> axes() const;
  std::optional<Axis> axis(const std::string& name) const;
  std::int64_t count() const;
  RunSummary summary() const;
  // Returns the records from index `first` on, in order, without the sensors' data.
  std::vector<FusedRecord> outlines(std::int64_t first) const;
  PerSensor<std::int64_t> late() const;  // tags, radar frames, depth frames received after their
                                         // slot
  // Calls visit for records in index order from `first` on until it returns false. For a record
  // with blobs of a wrong size or non-finite values it throws Error with the record's number, or,
  // with `on_bad`, calls that and skips the record. Sensors not in `sensors` are not decoded and
  // not valid. in_parallel(n, work) must call work(0) ... work(n - 1) in any order; it decodes the
  // depth images of several records at a time. Callbacks are still called in order on this thread.
  using InParallel = std::function<void(std::size_t, const std::function<void(std::size_t)>&)>;
  void for_each(const std::function<bool(const FusedRecord&)>& visit, std::int64_t first = 0,
                const std::function<void(std::int64_t, const std::string&)>& on_bad = {},
                SensorSet sensors = {Sensor::spd, Sensor::radar, Sensor::depth},
                const InParallel& in_parallel = {}) const;
  FusedRecord read(std::int64_t index) const;
  // Returns the result of SQLite's integrity check; empty if sound.
  std::string check() const;

 private:
  void open(const std::string& network);
  void check_axis(const Axis& axis) const;
  Statement ask(const std::string& sql) const;  // with the whole budget
  std::vector<FusedRecord> records(const std::string& which) const;
  template <class T>
  std::vector<T> rows(const std::string& tail = {}) const;  // rows of T's table
  std::string path_, file_, shown_;                         // as given; behind links; printable
  sqlite3* db_ = nullptr;
  bool closed_ = false;      // is_closed(): immutable
  bool lacks_wal_ = false;   // not being written, and its -wal is missing or empty
  std::uint64_t bytes_ = 0;  // size when opened
  std::unique_ptr<Budget> budget_;
};

// Adds an event of level "note" to a run; `who`: its source. For a run in progress it is a
// transaction. A closed run is replaced by a copy with the note, of the same mode and owner, under
// the run's lock and without side files. Throws Error(disk) without space for the copy, and
// Error(failed) for a run that lacks its -wal.
void put_note(const std::string& path, const std::string& text, const std::string& who);
// Adds an event of level "label": the recording process labels its records with it, from the
// current slot on. Throws Error(failed) if the run is not being recorded.
void put_label(const std::string& path, const std::string& label, const std::string& who);

// Marks a run left "open" by a crash as "crashed", and folds back its WAL. Does nothing for files
// that are not a run, damaged, open in another program, or not writable.
void recover(const std::string& path);

}  // namespace echofuse::record
