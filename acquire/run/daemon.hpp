// SPDX-License-Identifier: MIT
// The `run` command: devices -> windows -> run file, in real time.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::acquire {

struct RunOptions {
  std::string out;                        // the run file to make
  std::int64_t slots_a_file = 0;          // after which the next run begins; 0: one run
  std::function<std::string()> next_out;  // names the file of the next run
  std::optional<std::int64_t> count;      // slots; none: until interrupted
  std::vector<std::pair<std::string, std::string>> meta;
  std::string uuid;              // the first run's; empty: a new one
  std::int64_t countdown_s = 0;  // between the devices' answer and the first slot
  bool quiet = false;
  std::function<void(std::string)> show_status;  // none: to stderr
  std::vector<std::string> on_doubt;             // program and arguments (DoubtHook); empty: none
  bool strict = false;                  // the code partial if a record has a sensor that is not ok
  std::string keep_raw;                 // folder for the devices' bytes; empty: not kept
  std::optional<HostTime> kept_slot{};  // begin of slot 0 of kept bytes, which are nobody's device
  std::function<void(std::int64_t)> progress;  // told how many records are on disk, as they come
  std::function<void(const std::string&)> opened;  // called with each run's file
};

// Records one run, or with `slots_a_file` one after another without a gap: each is a run by itself,
// whose records begin at 0. Returns when the last run is closed: after `count` slots, or after the
// slot in which SIGINT or SIGTERM came. A slot that would take longer than close_limit is given up,
// and the run ends as stopped:interrupted. Returns partial only if asked for. Throws Error: the
// file exists, no device answers, the disk fails.
ExitCode record_run(const Config& config, const RunOptions& options, port::Loop& loop);

}  // namespace echofuse::acquire
