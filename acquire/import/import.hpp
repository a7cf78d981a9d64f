// SPDX-License-Identifier: MIT
// The `import` command: converts third-party recordings into a run.
//   .dat        bytes of the radar's data port, with the board's .cfg
//   .ptu        PicoQuant time tags
//   a folder    NumPy arrays or a raw capture of `run --keep-raw`
// A record contains the samples of its slot, as in a live run. Times are those of the recording;
// slot 0 begins with it. Two recordings, one per sensor, are assumed to begin at the same time.
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
  std::string cfg{};       // radar cfg; empty: next to its recording
  std::string began{};     // UTC, ISO 8601; empty: start time of the files
  std::int32_t start = 0;  // input of the laser's pulses; 0 is the sync
  std::int32_t click = 1;  // input of the detector
  std::string out{};       // path of the new run
};

// "2024-02-07T12:34:56Z" or "...+01:00", with or without a fraction or the time. Throws
// Error(usage), also for a day that the month does not have.
UtcTime parse_utc(const std::string& text);

// Creates the run. Returns its contents and its missing or assumed data, one per line; these lines
// are also events of the run. `config` gives slots, histogram, board and calibration; its addresses
// are ignored. Throws Error(failed) if a file is unreadable, of an unknown type or gives no valid
// record, or if the run exists; Error(disk) if the run cannot be written; Error(partial) if the run
// is written but one file gives no valid record.
std::string import_recordings(Config config, const ImportOptions& options);

// Converts a folder of NumPy arrays (array_folder.hpp) into the run file `out`. Only this function
// writes runs from arrays. Slot i begins i slot lengths after `began`, or after the time of the
// newest array. With the key `run` in run.toml the arrays replace those of that run; its axes,
// calibration, antennas, labels, times and metadata are copied.
// Returns the contents of the run, then warnings, one per line. Throws Error(config) if run.toml
// does not match the arrays; Error(failed) if arrays are unreadable, do not match each other or
// give no valid record; Error(disk).
std::string import_arrays(const std::string& folder, const std::string& out,
                          std::optional<UtcTime> began);

// Raw captures of `run --keep-raw` (raw_tap.hpp) are replayed: ports deliver the bytes at their
// receive times. The loop's time jumps.
bool is_kept(const std::string& folder);  // true for a raw capture

// Returns the configuration of the live run, changed by `assignments`.
Config kept_config(const std::string& folder, const std::vector<std::string>& assignments);

// Creates the run `out` with the slots of the live run; returns one line about it. Throws
// Error(failed) if files of the folder are missing or damaged, and the errors of record_run.
std::string import_kept(Config config, const std::string& folder, const std::string& out);

}  // namespace echofuse::acquire
