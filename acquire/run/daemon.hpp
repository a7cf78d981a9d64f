// SPDX-License-Identifier: MIT
// The `run` command: records devices to a run file in real time.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

struct RunOptions {
  std::string out;                        // run file to create
  std::int64_t slots_a_file = 0;          // number of slots per run; 0: one run
  std::function<std::string()> next_out;  // returns the file name of the next run
  std::optional<std::int64_t> count;      // number of slots; no value: until interrupted
  std::vector<std::pair<std::string, std::string>> meta;
  std::string uuid;              // uuid of the first run; empty: random
  std::int64_t countdown_s = 0;  // between the devices' answer and the first slot
  bool quiet = false;
  std::function<void(std::string)> show_status;  // empty: print to stderr
  std::vector<std::string> on_doubt;             // program and arguments (DoubtHook); empty: none
  bool strict = false;                  // return partial if a record has a sensor that is not ok
  std::string keep_raw;                 // folder for raw bytes; empty: not stored
  std::optional<HostTime> kept_slot{};  // start of slot 0 when importing raw bytes; then no devices
                                        // are in use
  std::function<void(std::int64_t)> progress;      // called with the number of records on disk
  std::function<void(const std::string&)> opened;  // called with the path of each run file
};

// Records one run, or with `slots_a_file` consecutive runs without a gap; the records of each begin
// at 0. Returns when the last run is closed: after `count` slots, or after the slot in which SIGINT
// or SIGTERM arrived. A slot that would take longer than close_limit is abandoned, and the run ends
// as stopped:interrupted. Returns partial only with `strict`. Throws Error: the file exists, no
// device answers, the disk fails.
ExitCode record_run(const Config& config, const RunOptions& options, port::Loop& loop);

}  // namespace echofuse::acquire
