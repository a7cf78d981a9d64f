// SPDX-License-Identifier: MIT
// Writes all rows of a run file to disk in order. Uses a worker thread, so that a slow disk never
// blocks the devices.
#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/intake/window.hpp"
#include "acquire/record/run_writer.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::acquire {

class RunLog;

// Threading: one thread calls all members. A worker thread executes the jobs and owns the
// RunWriter. When the next run begins, the worker switches to a new RunWriter and a second worker
// closes the old one. After a job has failed, later jobs are skipped and finish() reports the
// reason. Jobs wait while another program holds a write transaction on the run file.
class Journal {
 public:
  using WriteJob = std::function<void(record::RunWriter&)>;
  static constexpr std::size_t default_capacity = 64;

  // Writes a clock anchor, i.e. a monotonic time and the corresponding UTC. `loop` provides the
  // clock and the workers; it must outlive the journal.
  Journal(std::unique_ptr<record::RunWriter> run, port::Loop& loop,
          std::size_t capacity = default_capacity);
  // If finish() was not called, the run is left unclosed, as after a crash.
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // Writes a record. If `capacity` jobs are waiting, writes only the row of the record without data
  // and returns false. The verdict of the record then names the cause: the disk or another program.
  // If ten times `capacity` jobs are waiting, the journal fails: it rejects new jobs but completes
  // the waiting ones.
  bool put(record::FusedRecord record);
  void put(WriteJob job);
  // Completes the run and begins the next one, which is created by `make`; later jobs write to it.
  // Writes a clock anchor to the next run; the caller must write the configuration, devices and
  // axes to it again. If `make` throws, the journal fails. If the previous run cannot be completed,
  // labelled or closed, e.g. because it was moved, the next run contains a warning.
  using MakeRun = std::function<std::unique_ptr<record::RunWriter>()>;
  void begin_next(MakeRun make);
  void put_config(const Config& config);
  void put_device(const DeviceInfo& device);  // writes a row if the sensor's device has changed
  // Writes the axes that the file does not contain yet.
  void put_axes(const std::vector<Axis>& axes);
  void put_late(record::LateCounts late);
  // Writes how much each driver counter has increased since the last call, and the counts of
  // unassigned samples, all in one transaction.
  void put_counters(PerSensor<std::vector<Counter>> counters, const UnassignedSamples& unassigned);

  // Writes a clock anchor once per minute. If the system clock has been set or the machine has been
  // suspended, writes an anchor immediately and logs a warning.
  void refresh_anchor(RunLog& log);
  // Returns the start of a slot as UTC. Must be called in slot order. If the system clock is set,
  // slots that began earlier keep the UTC of the clock before the change.
  UtcTime utc_of(HostTime slot_start);

  // Returns true if at least half of `capacity` jobs are waiting. A caller that has many records
  // should then wait for the disk.
  bool crowded() const { return waiting_ >= capacity_ / 2; }
  bool failed() const { return failed_ || !overflow_.empty(); }
  // Returns the cause of a delay: a slow disk, or a write transaction by another program.
  std::string delay_cause() const;
  std::int64_t written() const { return written_; }
  std::string path() const;
  // Returns no value unless a label event set the label of the last written record.
  std::optional<std::string> label() const;
  // Returns the free disk space in bytes after the last record; no value if unknown.
  std::optional<std::uint64_t> free_bytes() const;

  // Completes the waiting jobs and closes the run with `status`. If a job failed, closes the run as
  // "stopped:disk" if the disk was the reason, otherwise as "stopped:failed". Then throws that
  // job's Error, with the number of missing records. Returns false if another program that reads
  // the run prevents merging the WAL into the file (RunWriter::close).
  bool finish(const std::string& status);
  // Removes the run instead of closing it. Must be called before the first record.
  void discard();

 private:
  struct SlotAnchor {
    HostTime mono{};
    std::chrono::nanoseconds utc_offset{};  // UTC minus monotonic time
    HostTime from{};                        // start of the first slot for which the offset is valid
  };
  SlotAnchor put_anchor();
  void renew_anchor();
  void write(record::RunWriter& run, record::FusedRecord& record);
  void close_before(record::RunWriter& before, std::uint64_t labels);
  void take_label(std::optional<std::string> label);
  void attempt(const std::function<void()>& step);
  void put_faults(record::RunWriter& run);
  void fail(const std::exception_ptr& why);
  void stop();

  record::LockWait lock_wait_;  // state of the wait for a locked run file, shared by all writers
  // Replaced by the worker when the next run begins; guarded by mutex_.
  std::unique_ptr<record::RunWriter> run_;
  const std::size_t capacity_;
  const Clock& clock_;
  std::set<std::string> axes_;         // names of the axes already written
  PerSensor<std::string> identities_;  // identities of the devices already written
  // Values of the driver counters at the last call of put_counters().
  PerSensor<std::map<std::string, std::uint64_t>> counted_;
  std::deque<SlotAnchor> anchors_;  // anchors that open slots still use, then the current anchor
  std::int64_t put_ = 0;            // number of records passed to put()
  // Reason why too many jobs are waiting; empty if the queue has not overflowed.
  std::string overflow_;

  mutable std::mutex mutex_;
  std::atomic<std::size_t> waiting_ = 0;  // number of jobs not yet started
  std::atomic<bool> failed_ = false;
  std::atomic<std::int64_t> written_ = 0;
  std::atomic<std::uint64_t> labels_ = 0;  // number of label events so far
  // Label of the last label event; set by the workers, guarded by mutex_.
  std::optional<std::string> label_;
  std::optional<std::uint64_t> free_;  // free bytes on the run's disk; guarded by mutex_
  std::exception_ptr failure_;         // first exception of a job; set before failed_
  // Faults of runs that have ended, which the next job writes to the current run; guarded by
  // mutex_.
  std::vector<std::string> faults_;
  std::atomic<int> closing_ = 0;  // number of runs being closed
  std::unique_ptr<port::Worker> closer_, worker_;
};

// Log of a run. All events are printed on the terminal; warnings, errors and recoveries are also
// written to the run file. Each source may log 100 lines in 10 s, so that a device cannot fill the
// disk or the queue of the journal. The next line after that reports the number of dropped lines.
// Threading: used only on the loop's thread.
class RunLog {
 public:
  explicit RunLog(const Clock& clock) : clock_(clock) {}
  // If `recovery` is true, writes the event to the run file even if it is not a warning.
  void put(Severity severity, const std::string& source, const std::string& text,
           bool recovery = false);
  // Writes the events that were logged before the run file existed; later events go to `journal`
  // directly. `journal` must outlive this object.
  void attach(Journal& journal);

 private:
  struct LogSource {
    HostTime since{};
    unsigned lines = 0, left_out = 0;
  };
  void write(Severity severity, const std::string& source, const std::string& text, bool kept);

  const Clock& clock_;
  std::map<std::string, LogSource> sources_;
  Journal* journal_ = nullptr;
  std::vector<Journal::WriteJob> waiting_;  // events logged before the run file existed
};

// Logs one warning each for late, duplicate and out-of-order samples, if there are any.
void report_unassigned(RunLog& log, const UnassignedSamples& unassigned);

}  // namespace echofuse::acquire
