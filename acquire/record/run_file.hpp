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
#include "acquire/record/record.hpp"
#include "drivers/core/zone.hpp"

struct sqlite3;

namespace echofuse::record {

class FileWatch;
class Statement;
struct WriterLock;
struct Budget;

inline constexpr int application_id = 0x4543464d;  // "ECFM"
inline constexpr int format_version = 3;
// Largest index of a record, so that the one after it is a number too.
inline constexpr std::int64_t max_index = std::int64_t{1} << 53;

struct Counted {
  std::string source, name;  // sensor, what was counted
  std::uint64_t value = 0;
};

// Waiting time of writers while another program holds a write transaction. CLOCK_MONOTONIC, ns.
// Threading: any thread.
struct Patience {
  std::atomic<std::int64_t> give_up_ns = std::numeric_limits<std::int64_t>::max();
  std::atomic<std::int64_t> waited_ns = 0;  // the last time that one had to
  bool tried() const;                       // one waits just now
};

// Threading: one thread at a time. Every member throws Error (disk for a full disk or a failed
// write, failed for anything else); after a failed append the file is as it was before it. Every
// member first looks whether the file is still there, the same and sound; close() reads all of it
// for that. If it is not, they throw Error(disk), and close() keeps what was committed in a copy
// that its Error names.
class RunWriter {
 public:
  // Refuses a path that exists. A run that has no uuid gets one. `clock`, which outlives this,
  // tells when the run began and ended. The file appears when it is whole, with what
  // `begin` puts: kill -9 before leaves PATH-new, which the next writer removes.
  using Begin = std::function<void(RunWriter&)>;
  RunWriter(const std::string& path, const RunInfo& info, const Clock& clock = system_clock,
            const Begin& begin = {});
  ~RunWriter();  // without close(): status stays "open", which readers show as crashed
  RunWriter(const RunWriter&) = delete;
  RunWriter& operator=(const RunWriter&) = delete;

  // Call once per axis name, before the first record that needs it.
  void put_axis(const Axis& axis);
  void put_device(const DeviceInfo& device);    // a row more if one of this sensor answered before
  void put_antennas(const Antennas& antennas);  // replaces those of the array axis
  void put_zones(const Zones& zones);           // once, before the first record
  void put_calibration(const CalibrationEntry& entry);
  void put_policy(Sensor sensor, const std::string& policy);  // required or optional
  void put_anchor(HostTime mono, UtcTime utc);
  // Call at the end with all counters: one transaction.
  void put_counters(std::span<const Counted> counters);
  // Adds what came late to what is known of these records. All in one transaction.
  void put_late(const LateCounts& late);
  void put_event(UtcTime utc, Severity severity, const std::string& source,
                 const std::string& text);
  void append(const FusedRecord& record);
  // The last label that put_label() left in this file since the last call and before this time;
  // none if there is none. After close(): the last one that came until then.
  std::optional<std::string> new_label(UtcTime before);
  void append(std::span<const FusedRecord> batch);  // one transaction: for the generator
  // Folds the WAL back, so that one single file is left. Throws Error(failed) at the end if another
  // program added tables, so that readers refuse the file. False if another program reads the run
  // just now: close() waits half a second for it, and then the last records stay in the WAL until
  // recover() or a writer folds them back. `unwritten`: records that could not be written; an event
  // and the counter run/unwritten state them.
  bool close(const std::string& status, std::int64_t unwritten = 0);
  void close_as_one_file(const std::string& status);  // throws Error(failed) instead
  bool lost() const { return !harm_.empty(); }        // as the last call found
  // Reserves room on the disk again, so that the status can be written when it is full.
  void reserve() const;

  // Another program may hold the file by a write transaction. A call waits for its end, for 30 s,
  // or, with this, which outlives the writer, until it says. Then it throws Error(disk).
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
  bool touched_ = false;  // by somebody else, before a checkpoint of ours
  std::string harm_;      // harm done to the file
  Patience* patience_ = nullptr;
  std::int64_t waits_since_ns_ = 0;
  std::optional<std::string> left_label_;  // at the end
  std::vector<Axis> axes_;
  std::size_t histograms_ = 1;  // number in a record
  std::int64_t records_ = 0, last_event_ = 0;
};

struct Event {
  std::string utc, level, source, text;
  std::optional<std::int64_t> id = {};  // made by SQLite, in the order of the events
};

struct Anchor {  // one moment on both clocks
  HostTime mono{};
  UtcTime utc{};
};

// A run in numbers, without reading the sensors' data.
struct RunSummary {
  std::int64_t records = 0, all_valid = 0;  // all_valid: of records with all three sensors
  std::int64_t incomplete = 0;              // records that lack a required sensor
  std::int64_t doubtful = 0;                // records with a verdict other than ok
  PerSensor<std::int64_t> valid{};          // records with a valid SPD, radar, depth
  PerSensor<std::int64_t> lost{};           // tags, radar frames, depth frames
  std::int64_t tags = 0;
  std::int64_t arrays = 0, array_frames = 0;  // records with the radar's array, their frames
  std::int64_t last_index = -1;               // the largest of a record
  UtcTime first_utc{}, last_utc{};            // start of the first slot, end of the last
  std::map<std::string, std::int64_t> labels, events;  // records by label, events by level
  std::map<std::string, std::string> policies;         // by sensor
  // Records by sensor and verdict, without the figures behind a verdict's colon.
  PerSensor<std::map<std::string, std::int64_t>> verdicts;
  PerSensor<std::optional<ClockState>> clocks;  // last record's that has them
};

// "28 of 75 doubtful: radar missing 11, weak 10; camera frozen 7"; empty if none is.
std::string doubts_of(const RunSummary& sum);
// A verdict without the figures behind its colon.
std::string verdict_kind(const std::string& verdict);
// Counts one record's verdicts in `verdicts` and `doubtful`.
void count_verdicts(RunSummary& sum, const PerSensor<std::string>& verdicts);

// The status of a copy of a run that was not closed, without the RUN-wal that has its last records.
// A run that was killed as it began looks the same.
inline constexpr const char* crashed_without_wal = "crashed, no -wal";
// The status of a copy that SQLite made of an open run (VACUUM INTO): a closed file with the
// records of that moment.
inline constexpr const char* copy_of_open = "copy of an open run";

// Reads closed, live and crashed runs alike. Threading: one thread at a time.
class RunReader {
 public:
  // Throws Error(failed): not there, not a run file, of another format, damaged, or with anything
  // but a run's tables. Size bounds the cost of reading a file. A closed run is immutable: files of
  // SQLite next to it are not read. On a network file system only a closed run is read.
  explicit RunReader(const std::string& path);
  RunReader(const std::string& path, const std::string& network);  // as network_of(path) says
  ~RunReader();
  RunReader(const RunReader&) = delete;
  RunReader& operator=(const RunReader&) = delete;

  const std::string& path() const { return path_; }
  // Files of SQLite next to a closed run. They are not part of it.
  std::vector<std::string> leftovers() const;
  // status "crashed", crashed_without_wal or copy_of_open, if it is "open" and no writer holds it
  RunInfo info() const;
  std::vector<DeviceInfo> devices() const;
  std::map<std::string, std::string> policies() const;  // by sensor
  std::vector<Anchor> anchors() const;
  std::vector<CalibrationEntry> calibrations() const;
  Antennas antennas() const;  // empty if the radar sent no samples of them
  Zones zones() const;        // empty of a single pixel
  std::vector<Event> events() const;
  std::vector<Event> last_events(std::size_t most) const;  // oldest first
  std::vector<Counted> counters() const;
  std::vector<Axis> axes() const;
  std::optional<Axis> axis(const std::string& name) const;
  std::int64_t count() const;
  RunSummary summary() const;
  // The records from index `first` on, in order, without the sensors' data.
  std::vector<FusedRecord> outlines(std::int64_t first) const;
  PerSensor<std::int64_t> late() const;  // tags, radar frames, depth frames after their slot
  // Gives records in index order from `first` on; the callback returns false to stop. A record
  // whose blobs do not fit the axes or hold non-finite values throws Error naming the record. With
  // `on_bad` it is handed there instead and skipped. Sensors not in `sensors` are not decoded, and
  // not valid. in_parallel(n, work) calls work(0) ... work(n - 1), in any order. With it, depth
  // pictures of some records at a time are decoded on its threads. Callbacks still come in order,
  // on this one.
  using InParallel = std::function<void(std::size_t, const std::function<void(std::size_t)>&)>;
  void for_each(const std::function<bool(const FusedRecord&)>& visit, std::int64_t first = 0,
                const std::function<void(std::int64_t, const std::string&)>& on_bad = {},
                SensorSet sensors = {Sensor::spd, Sensor::radar, Sensor::depth},
                const InParallel& in_parallel = {}) const;
  FusedRecord read(std::int64_t index) const;
  // SQLite's own integrity check; empty if sound.
  std::string check() const;

 private:
  void open(const std::string& network);
  void check_axis(const Axis& axis) const;
  Statement ask(const std::string& sql) const;  // grants the whole budget
  std::vector<FusedRecord> records(const std::string& which) const;
  template <class T>
  std::vector<T> rows(const std::string& tail = {}) const;  // rows of T's table
  std::string path_, file_, shown_;                         // as given; behind links; printable
  sqlite3* db_ = nullptr;
  bool closed_ = false;      // is_closed(): immutable
  bool lacks_wal_ = false;   // not being written, and its -wal is missing or empty
  std::uint64_t bytes_ = 0;  // when it was opened
  std::unique_ptr<Budget> budget_;
};

// An event of level "note" into a run; `who` is its source. A transaction of a run that is being
// recorded. A closed run is replaced by a copy with the note, of the same mode and owner, under the
// run's lock: no other file is made next to it. Throws Error(disk) without room for the copy, and
// Error(failed) for a run that lacks its -wal.
void put_note(const std::string& path, const std::string& text, const std::string& who);
// Writes an event of level "label". The recording process labels its records so, from the running
// slot on. Throws Error(failed) if nobody is recording this run.
void put_label(const std::string& path, const std::string& label, const std::string& who);

// Marks a run that a crash left "open" as "crashed", and folds back a WAL that was left beside it.
// Leaves alone what is no run, damaged, open in another program, or not ours to write.
void recover(const std::string& path);

}  // namespace echofuse::record
