// SPDX-License-Identifier: MIT
// The way of a run to its disk: records, and what a run file holds beside them, in order. The run
// file has its own worker, so that a slow disk never blocks the devices.
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

// Threading: all members are for one thread. The worker alone writes with the RunWriter, and
// replaces it where the next run begins; a second worker closes the run before. No job is done
// after the first that failed, and finish() tells why. While another program holds the run file by
// a write transaction, jobs wait.
class Journal {
 public:
  using Job = std::function<void(record::RunWriter&)>;
  static constexpr std::size_t default_capacity = 64;

  // `loop`, which outlives this, is its clock and makes its workers. Puts an anchor.
  Journal(std::unique_ptr<record::RunWriter> run, port::Loop& loop,
          std::size_t capacity = default_capacity);
  ~Journal();  // without finish(): the run stays as a crash would leave it
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // Returns false if `capacity` jobs are waiting. Then the record's data are given up, but its row
  // is still written; the verdict tells whether the disk or another program is why. At ten times as
  // many the journal has failed for that reason: it takes no more, but does what is waiting.
  bool put(record::FusedRecord record);
  void put(Job job);
  // Closes the run as complete and sends what comes later into the next one, which `make` opens.
  // Puts an anchor; configuration, devices and axes are put by the caller as for the first run. The
  // journal fails if `make` throws.
  using Make = std::function<std::unique_ptr<record::RunWriter>()>;
  void begin_next(Make make);
  void put_config(const Config& config);
  void put_device(const DeviceInfo& device);  // one row a device, not one a reconnection
  // Those that the file does not have; the zones with the axis spd.
  void put_axes(const std::vector<Axis>& axes, const Zones& zones = {});
  // Late samples by record.
  void put_late(record::LateCounts late);
  // Writes what the drivers counted since the last call, and the samples that are in no record; at
  // the end of a run, all or none.
  void put_counters(PerSensor<std::vector<Counter>> counters, const UnassignedSamples& unassigned);

  // A new anchor once a minute, and at once, with a warning, when the machine's clock was set or
  // the machine slept.
  void refresh_anchor(RunLog& log);
  // UTC of a slot's start; slots come in order. Slots that began before the clock was set keep the
  // old time.
  UtcTime utc_of(HostTime slot_start);

  // True if half of `capacity` jobs are waiting: a caller with many records at once should give the
  // disk time.
  bool crowded() const { return waiting_ >= capacity_ / 2; }
  bool failed() const { return failed_ || !overflow_.empty(); }
  std::string why_late() const;  // cause of a delay: the disk, or the program that holds the file
  std::int64_t written() const { return written_; }
  std::string path() const;  // file that is being written
  // Label that a mark gave to the records written last; none if none did.
  std::optional<std::string> label() const;
  // Free bytes of the run's disk after the last record; none if the system does not tell.
  std::optional<std::uint64_t> free_bytes() const;

  // Writes what is waiting and closes the run with this status, or, if a job failed, with
  // "stopped:disk" or (for another reason) "stopped:failed"; then throws that job's Error, which
  // says how many records are not in the file. False if a reader keeps the run from being one file
  // (RunWriter::close).
  bool finish(const std::string& status);

 private:
  struct SlotAnchor {
    HostTime mono{};
    std::chrono::nanoseconds utc_offset{};  // UTC minus monotonic time
    HostTime from{};                        // the first slot start that it stands for
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
  PerSensor<std::map<std::string, std::uint64_t>> counted_;  // by drivers, in the runs before
  std::deque<SlotAnchor> anchors_;  // the last one, and before it those that open slots began with
  std::int64_t put_ = 0;            // records
  std::string overflow_;            // why more jobs wait than may

  mutable std::mutex mutex_;
  std::atomic<std::size_t> waiting_ = 0;  // jobs that have not begun
  std::atomic<bool> failed_ = false;
  std::atomic<std::int64_t> written_ = 0;
  std::atomic<std::uint64_t> labels_ = 0;  // taken so far
  std::optional<std::string> label_;       // set by a mark, by the workers; guarded by mutex_
  std::optional<std::uint64_t> free_;      // on its disk; guarded by mutex_
  std::exception_ptr failure_;             // set once, before failed_
  std::atomic<int> closing_ = 0;           // runs
  std::unique_ptr<port::Worker> closer_, worker_;
};

// Log of a run: events go to the terminal; warnings, errors and recoveries also into the run. A
// source has 100 lines in 10 s, so that no device fills the disk or the journal's queue. The next
// line after that says how many were left out. Threading: the loop's thread only.
class RunLog {
 public:
  explicit RunLog(const Clock& clock) : clock_(clock) {}
  // A `recovery` goes into the run as well, though it is no warning.
  void put(Severity severity, const std::string& source, const std::string& text,
           bool recovery = false);
  // Writes the events so far into the run first. `journal` must outlive this.
  void attach(Journal& journal);

 private:
  struct Source {
    HostTime since{};
    unsigned lines = 0, left_out = 0;
  };
  void write(Severity severity, const std::string& source, const std::string& text, bool kept);

  const Clock& clock_;
  std::map<std::string, Source> sources_;
  Journal* journal_ = nullptr;
  std::vector<Journal::Job> waiting_;  // events from before the file existed
};

// A warning for each kind of unassigned samples that matters.
void report_unassigned(RunLog& log, const UnassignedSamples& unassigned);

}  // namespace echofuse::acquire
