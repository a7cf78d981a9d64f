// SPDX-License-Identifier: MIT
// The `run` command: records devices to a run file in real time.
#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/devices/devices.hpp"
#include "acquire/intake/scheduler.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

struct RunOptions {
  std::string out;
  std::int64_t slots_a_file = 0;          // number of slots per run file; 0: all slots in one file
  std::function<std::string()> next_out;  // returns the file name of the next run
  // Number of slots to record; no value: record until interrupted.
  std::optional<std::int64_t> count;
  std::vector<std::pair<std::string, std::string>> meta;
  std::string uuid;              // UUID of the first run; empty: random
  std::int64_t countdown_s = 0;  // duration of the countdown before slot 0, s; 0: no countdown
  bool quiet = false;
  // Receives each status line; if empty, the lines are printed to stderr.
  std::function<void(std::string)> show_status;
  std::vector<std::string> on_doubt;  // program and arguments run by DoubtHook; empty: no program
  // If true, record_run() returns ExitCode::partial if any record is doubtful.
  bool strict = false;
  // Folder for the raw bytes of all ports; if empty, raw bytes are not stored.
  std::string keep_raw;
  // Start of slot 0 in an import, which uses no devices and no locks.
  std::optional<HostTime> kept_slot{};
  // Creates devices that play recordings. The run then ends with the last of them.
  Devices::MakeRecording recording{};
  std::deque<ClosedSlot> kept_closings{};      // slots that the recorded run closed
  std::function<void(std::int64_t)> progress;  // called with the number of records on disk
  // Called with the path of each run file that is opened.
  std::function<void(const std::string&)> opened;
};

// Records one run, or consecutive runs without a gap if `slots_a_file` is set. Record numbers begin
// at 0 in each run. Returns when the last run is closed: after `count` slots, or after the slot in
// which SIGINT or SIGTERM arrives. A slot that would then last more than 4 s (close_limit) is
// abandoned, and the run gets the status "stopped:interrupted". Returns ExitCode::partial only if
// `strict` is set. Throws Error if the file exists, no device delivers data or the disk fails.
ExitCode record_run(const Config& config, const RunOptions& options, port::Loop& loop);

}  // namespace echofuse::acquire
