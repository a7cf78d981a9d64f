// SPDX-License-Identifier: MIT
// Writes a run to disk in order: records and all other rows of a run file. Uses its own worker, so
// that a slow disk never blocks the devices.
#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/run/window.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::acquire {

class RunLog;

// Threading: one thread calls all members. One worker thread executes the jobs and owns the
// RunWriter. At the start of the next run the worker switches to a new RunWriter, and a second
// worker closes the old one. If a job fails, the later jobs are skipped and finish() reports the
// reason. Jobs wait while another program holds a write transaction on the run file.
class Journal {
 public:
  using WriteJob = std::function<void(record::RunWriter&)>;
  static constexpr std::size_t default_capacity = 64;

  // `loop` must outlive this; it provides clock and workers. Writes an anchor.
  Journal(std::unique_ptr<record::RunWriter> run, port::Loop& loop,
          std::size_t capacity = default_capacity);
  ~Journal();  // without finish(): leaves the run as after a crash
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // Returns false if `capacity` jobs are waiting. Then only the record's row is written, without
  // data; the verdict states whether the disk or another program is the cause. With ten times that
  // number the journal fails: it rejects new jobs but completes the waiting ones.
  bool put(record::FusedRecord record);
  void put(WriteJob job);
  // Closes the run as complete and directs later jobs to the next one, created by `make`. Writes an
  // anchor; the caller puts configuration, devices and axes as for the first run. If `make` throws,
  // the journal fails.
  using MakeRun = std::function<std::unique_ptr<record::RunWriter>()>;
  void begin_next(MakeRun make);
  void put_config(const Config& config);
  void put_device(const DeviceInfo& device);  // one row per device, not per reconnection
  // Writes axes that the file does not have yet; zones together with the axis spd.
  void put_axes(const std::vector<Axis>& axes, const Zones& zones = {});
  // Late samples per record.
  void put_late(record::LateCounts late);
  // Writes the drivers' counts since the last call, and the samples in no record; at the end of a
  // run all or none.
  void put_counters(PerSensor<std::vector<Counter>> counters, const UnassignedSamples& unassigned);

  // Writes an anchor once per minute, and immediately, with a warning, if the system clock was set
  // or the machine was suspended.
  void refresh_anchor(RunLog& log);
  // Returns the UTC of a slot's start; call in slot order. Slots that began before the clock was
  // set keep the old time.
  UtcTime utc_of(HostTime slot_start);

  // Returns true if half of `capacity` jobs are waiting. A caller with many records should then
  // wait for the disk.
  bool crowded() const { return waiting_ >= capacity_ / 2; }
  bool failed() const { return failed_ || !overflow_.empty(); }
  std::string why_late() const;  // cause of a delay: the disk, or the program that holds the file
  std::int64_t written() const { return written_; }
  std::string path() const;  // file being written
  // Label of the last records written, if it was set by an event.
  std::optional<std::string> label() const;
  // Free bytes of the run's disk after the last record; no value if unknown.
  std::optional<std::uint64_t> free_bytes() const;

  // Writes waiting jobs and closes the run with this status. If a job failed, closes it as
  // "stopped:disk" or (for other reasons) "stopped:failed" and throws that job's Error, which
  // states the number of missing records. Returns false if a reader prevents closing as one file
  // (RunWriter::close).
  bool finish(const std::string& status);

 private:
  struct SlotAnchor {
    HostTime mono{};
    std::chrono::nanoseconds utc_offset{};  // UTC minus monotonic time
    HostTime from{};                        // first slot start for which it is valid
  };
  SlotAnchor put_anchor();
  void renew_anchor();
  void write(record::RunWriter& run, record::FusedRecord& record);
  void close_before(record::RunWriter& before, std::uint64_t labels);
  void take_label(std::optional<std::string> label);
  void fail(const std::exception_ptr& why);
  void stop();

  record::Patience patience_;               // shared by all writers
  std::unique_ptr<record::RunWriter> run_;  // replaced by the worker; guarded by mutex_
  const std::size_t capacity_;
  const Clock& clock_;
  std::set<std::string> axes_;                               // by name
  PerSensor<std::string> identities_;                        // devices already written
  PerSensor<std::map<std::string, std::uint64_t>> counted_;  // by drivers, in previous runs
  std::deque<SlotAnchor> anchors_;  // the current one, preceded by those of open slots
  std::int64_t put_ = 0;            // number of records
  std::string overflow_;            // reason of failure if too many jobs wait

  mutable std::mutex mutex_;
  std::atomic<std::size_t> waiting_ = 0;  // jobs not yet started
  std::atomic<bool> failed_ = false;
  std::atomic<std::int64_t> written_ = 0;
  std::atomic<std::uint64_t> labels_ = 0;  // number of labels so far
  std::optional<std::string> label_;       // from an event, set by the workers; guarded by mutex_
  std::optional<std::uint64_t> free_;      // on the run's disk; guarded by mutex_
  std::exception_ptr failure_;             // set once, before failed_
  std::atomic<int> closing_ = 0;           // number of runs
  std::unique_ptr<port::Worker> closer_, worker_;
};

// Log of a run: events go to the terminal; warnings, errors and recoveries also to the run file. A
// source may log 100 lines in 10 s, so that a device cannot fill the disk or the journal's queue.
// The next line states the number of dropped lines. Threading: the loop's thread.
class RunLog {
 public:
  explicit RunLog(const Clock& clock) : clock_(clock) {}
  // A `recovery` is also written to the run, although it is not a warning.
  void put(Severity severity, const std::string& source, const std::string& text,
           bool recovery = false);
  // First writes earlier events to the run. `journal` must outlive this.
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
  std::vector<Journal::WriteJob> waiting_;  // events before the file existed
};

// Logs a warning for each kind of unassigned samples that occurred.
void report_unassigned(RunLog& log, const UnassignedSamples& unassigned);

}  // namespace echofuse::acquire
