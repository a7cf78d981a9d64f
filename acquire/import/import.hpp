// SPDX-License-Identifier: MIT
// The `import` command: converts third-party recordings into a run.
//   .dat        bytes of the radar's data port, with the board's .cfg
//   .ptu        PicoQuant time tags
//   a folder    NumPy arrays or a raw capture of `run --keep-raw`
// A record contains the samples of its slot, as in a live run. Times are taken from the recording;
// slot 0 begins at its start. Two recordings, one per sensor, are assumed to begin at the same
// time.
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
  std::string cfg{};       // radar .cfg file; empty: .cfg file next to the recording
  std::string began{};     // start time, UTC, ISO 8601; if empty, it is derived from the files
  std::int32_t start = 0;  // tagger input for the laser pulses; 0: sync input
  std::int32_t click = 1;  // tagger input for the detector
  std::string out{};
};

// Parses a time such as "2024-02-07T12:34:56Z" or "2024-02-07T12:34:56.5+01:00"; the time of day is
// optional. Throws Error(usage) for any other string and for a day that does not exist in that
// month.
UtcTime parse_utc(const std::string& text);

// Creates a run from recordings. Returns a line about its contents, then one line for each missing
// or assumed item; these lines are also written to the run as events. The slot duration, the
// histogram settings, the radar board and the calibration are taken from `config`; the addresses in
// `config` are ignored. Throws Error(usage) for an unknown file type; Error(failed) if a file is
// unreadable or yields no valid record, or if the run exists; Error(disk) if the run cannot be
// written. Throws Error(partial) if the run was written but one of the files yields no valid
// record.
std::string import_recordings(Config config, const ImportOptions& options);

// Converts a folder of NumPy arrays (array_folder.hpp) into the run file `out`. No other function
// writes runs from arrays. Slot 0 begins at `began` or, if `began` has no value, at the
// modification time of the newest array. The slots follow each other without gaps. If run.toml has
// the key `run`, the arrays replace the values of that run; its axes, calibration, antennas,
// labels, times and metadata are copied. Returns a line about the contents of the run, then the
// warnings, one per line. Throws Error(config) if run.toml does not match the arrays; Error(failed)
// if arrays are unreadable, do not match each other or yield no valid record; Error(disk) if the
// run cannot be written.
std::string import_arrays(const std::string& folder, const std::string& out,
                          std::optional<UtcTime> began);

// Returns true if the folder is a raw capture of `run --keep-raw` (raw_tap.hpp).
bool is_kept(const std::string& folder);

// Returns the configuration of the captured run after applying `assignments`.
Config kept_config(const std::string& folder, const std::vector<std::string>& assignments);

// Creates the run `out` with the slots of the captured run; returns one line about its contents.
// Replays the capture: the bytes are delivered at their original arrival times, and the loop's
// clock jumps from one event to the next. Throws Error(failed) if files of the folder are missing
// or damaged. Also throws the errors of record_run().
std::string import_kept(Config config, const std::string& folder, const std::string& out);

}  // namespace echofuse::acquire
