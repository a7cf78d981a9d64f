// SPDX-License-Identifier: MIT
// Runs the program alert.on_doubt when the run starts and ends, and each time the state of a sensor
// or of the disk changes: when a problem begins, is replaced by another one, or ends.
#pragma once
#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/alerts.hpp"
#include "acquire/record/fused_record.hpp"

namespace echofuse::acquire {

// Passes each change of state to the program in environment variables (ECHOFUSE_SOURCE and others,
// see acquire/RECORDS.md). Runs one program at a time. If a program runs for longer than `longest`,
// kills this program and its child processes. Threading: all members must be called on the same
// thread; only finish() blocks.
class DoubtHook {
 public:
  static constexpr std::chrono::seconds longest{10};
  // Maximum number of waiting changes; further changes are dropped.
  static constexpr std::size_t max_waiting = 16;
  using Warn = std::function<void(const std::string&)>;

  // `words` contains the program and its arguments; if it is empty, this object does nothing.
  // Throws Error(config) if words[0] cannot be executed. `limits.after_s` is used as it is; 0
  // reports every change at once.
  DoubtHook(std::vector<std::string> words, const record::AlertLimits& limits, Warn warn);
  ~DoubtHook();  // kills a running program
  DoubtHook(const DoubtHook&) = delete;
  DoubtHook& operator=(const DoubtHook&) = delete;

  // Queues a change for each configured sensor if its state differs from that in the previous
  // record.
  void take(const record::FusedRecord& record, SensorSet configured, const std::string& run);
  void take_disk(std::optional<std::uint64_t> free_bytes, UtcTime now, const std::string& run);
  // Queues a change of the run itself: "started", or "ended" with the reason.
  void take_run(const char* kind, const std::string& text, UtcTime now, const std::string& run);
  // Starts the program for the next change; kills a program that has run for longer than `longest`.
  // Must be called every 50 ms.
  void update(HostTime now);
  // Spends at most one second on reporting the waiting changes, then kills the running program.
  // Warns about changes that were not reported.
  void finish(HostTime now);

 private:
  struct AlertChange {
    std::string source, kind, text, run, utc;
    std::optional<std::int64_t> record;
  };
  void put(AlertChange change);
  void start(const AlertChange& change, HostTime now);
  bool ended();
  void kill_program();

  const std::vector<std::string> words_;
  const record::AlertLimits limits_;
  const Warn warn_;
  // Last state of each source; a source that has no entry is ok.
  std::map<std::string, std::string> kinds_;
  PerSensor<record::LastingState> states_;
  std::deque<AlertChange> waiting_;
  std::optional<pid_t> program_;
  HostTime started_{};
  bool killed_ = false;
};

}  // namespace echofuse::acquire
