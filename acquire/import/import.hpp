// SPDX-License-Identifier: MIT
// The `import` command: recordings of other programs become a run.
//   .dat        the radar's data port, with the .cfg that the board had
//   .ptu        PicoQuant's time tags
//   a folder    NumPy arrays or what `run --keep-raw` kept
// A record is made of the samples of its slot as in a live run, by the times of the recording; slot
// 0 begins with it. Two recordings, one of each sensor, are taken to
// begin at the same time.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

struct ImportOptions {
  std::vector<std::string> files{};
  std::string cfg{};       // the radar's; empty: beside its recording
  std::string began{};     // UTC, ISO 8601; empty: as the files have it
  std::int32_t start = 0;  // input of the laser's pulses; 0 is the sync
  std::int32_t click = 1;  // input of the detector
  std::string out{};       // the run to make
};

// "2024-02-07T12:34:56Z" or "...+01:00", with or without a fraction or the time. Throws
// Error(usage), also for a day that the month does not have.
UtcTime parse_utc(const std::string& text);

// Makes the run and returns what is in it, and what is missing or assumed, a line each;
// the run has these lines as events. `config` says how a record is made: slots, histogram, board,
// calibration. Its addresses are not used. Throws Error: a file cannot be read, is none of these or
// gives no record anything (failed), the run exists (failed) or cannot be written (disk); the run
// is made, but one of its files gives it nothing (partial).
std::string import_recordings(Config config, const ImportOptions& options);

// A folder of NumPy arrays as a run (array_folder.hpp): the way in for histograms and maps of other
// programs, and the only writer of runs from arrays. Slot i begins i slot lengths after `began`, or
// after the time of the newest array. With run.toml's key `run` the arrays replace those of that
// run; its axes, calibration, antennas, labels, times and metadata stay.
// Makes the run file `out` and returns what is in it, then what is doubtful, a line each. Throws
// Error: run.toml does not fit (config), arrays cannot be read, do not fit each other or give no
// valid record (failed), disk.
std::string import_arrays(const std::string& folder, const std::string& out,
                          std::optional<UtcTime> began);

// Recording of a folder of `run --keep-raw` as a run: the daemon's ports hand out the kept bytes at
// the times at which they came (raw_tap.hpp). The loop's time jumps.
bool is_kept(const std::string& folder);  // whether `run --keep-raw` made it

// The configuration that the live run had, changed by `assignments`.
Config kept_config(const std::string& folder, const std::vector<std::string>& assignments);

// Makes the run `out` with the slots of the live one and says so in a line. Throws Error: files of
// the folder are missing or damaged (failed), or as record_run does.
std::string import_kept(Config config, const std::string& folder, const std::string& out);

}  // namespace echofuse::acquire
