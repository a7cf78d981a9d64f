// SPDX-License-Identifier: MIT
// Run file: an SQLite database (WAL, synchronous=FULL) with one transaction per append. Committed
// records survive kill -9, power loss and a full disk. The file can be read while it is written.
//   PRAGMA application_id = 0x4543464d ("ECFM"), user_version = 4
//   tables: see rows.hpp; data columns of the table record: see columns.hpp
#pragma once
#include <atomic>
#include <functional>
#include <limits>
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
struct WriterLock;

// Times in ns (CLOCK_MONOTONIC) of a writer that waits for another program's write transaction.
// Threading: any thread.
struct LockWait {
  std::atomic<std::int64_t> give_up_ns = std::numeric_limits<std::int64_t>::max();
  std::atomic<std::int64_t> waited_ns = 0;  // last time at which a writer was waiting
  bool tried() const;  // Returns true if a writer was waiting within the last 100 ms.
};

// Throws Error(failed) if the path exists.
void refuse_existing(const std::string& path);

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

  // Makes the writer wait for another program's write transaction until `lock_wait.give_up_ns`,
  // instead of at most 30 s. After that time, the waiting call throws Error(disk). `lock_wait` must
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
  void require_intact();
  void require_complete();
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

}  // namespace echofuse::record
