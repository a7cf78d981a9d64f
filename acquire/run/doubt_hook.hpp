// SPDX-License-Identifier: MIT
// Runs the program of alert.on_doubt for each change of a sensor or of the disk: when a doubt
// begins, becomes another one, or ends.
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

// Threading: one thread, which only finish() blocks. The program gets the change in its environment
// (ECHOFUSE_SOURCE and others, acquire/README.md). One program runs at a time; it is killed, with
// the programs that it started, after `longest`.
class DoubtHook {
 public:
  static constexpr std::chrono::seconds longest{10};
  static constexpr std::size_t most_waiting = 16;  // changes; further ones are dropped
  using Warn = std::function<void(const std::string&)>;

  // Does nothing if `words` is empty. Throws Error(config) if words[0] cannot be executed.
  DoubtHook(std::vector<std::string> words, const record::AlertLimits& limits, Warn warn);
  ~DoubtHook();  // kills a running program
  DoubtHook(const DoubtHook&) = delete;
  DoubtHook& operator=(const DoubtHook&) = delete;

  // Compares a record with the ones before.
  void take(const record::FusedRecord& record, SensorSet configured, const std::string& run);
  void take_disk(std::optional<std::uint64_t> free_bytes, UtcTime now, const std::string& run);
  // Starts the next program, and ends one that runs too long. To be called every 50 ms.
  void update(HostTime now);
  // Runs the waiting changes for a second at most, then kills the program. Warns of what was lost.
  void finish(HostTime now);

 private:
  struct AlertChange {
    std::string source, kind, text, run, utc;
    std::optional<std::int64_t> record;
  };
  void put(AlertChange change);
  void start(const AlertChange& change, HostTime now);
  bool ended();

  const std::vector<std::string> words_;
  const record::AlertLimits limits_;
  const Warn warn_;
  std::map<std::string, std::string> kinds_;  // by source; none: ok
  PerSensor<std::optional<HostTime>> last_valid_;
  std::deque<AlertChange> waiting_;
  std::optional<pid_t> program_;
  HostTime started_{};
  bool killed_ = false;
};

}  // namespace echofuse::acquire
