// SPDX-License-Identifier: MIT
// The `import` command: recordings of other programs become a run.
//   .dat        the radar's data port, with the .cfg that the board had
//   .ptu .phu   PicoQuant's time tags and histograms
//   a folder    NumPy arrays or what `run --keep-raw` kept
// A record is made of the samples of its slot as in a live run, by the times of the recording; slot
// 0 begins with it. A .phu gives one record a curve, of the curve's length. Two recordings, one of
// each sensor, are taken to begin at the same time.
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

// "2024-02-07T12:34:56Z", with or without "Z", a fraction, or the time. Throws Error(usage).
UtcTime parse_utc(const std::string& text);

// Makes the run and returns what is in it, and what is missing or taken for granted, a line each;
// the run has these lines as events. `config` says how a record is made: slots, histogram, board,
// calibration. Its addresses are not used. Throws Error: a file cannot be read, is none of these or
// gives no record anything (failed), the run exists (failed) or cannot be written (disk); the run
// is made, but one of its files gives it nothing (partial).
std::string import_recordings(Config config, const ImportOptions& options);

// A folder of NumPy arrays as a run: the way in for histograms and maps of other programs.
//   spd.npy     [n, bins] counts; a row of NaN: no SPD in that record
//   radar.npy   [n, points] linear power; a row of NaN: no radar
//   depth.npy   [n, rows, columns] z, whole millimetres or float metres; 0, NaN: no return
//   run.toml    axes with units, slot length, labels: bind() in arrays.cpp
// One of the first two is enough. Slot i begins i slot lengths after `began`.
// Makes the run file `out` and returns one line that says what is in it. Throws Error: run.toml
// does not fit (config), arrays cannot be read or do not fit each other (failed), disk.
std::string import_arrays(const std::string& folder, const std::string& out, UtcTime began);

// Recording of a folder of `run --keep-raw` as a run: the daemon's ports hand out the kept bytes at
// the times at which they came (raw_tap.hpp). The loop's time jumps.
bool is_kept(const std::string& folder);  // whether `run --keep-raw` made it

// The configuration that the live run had, changed by `assignments`.
Config kept_config(const std::string& folder, const std::vector<std::string>& assignments);

// Makes the run `out` with the slots of the live one and says so in a line. Throws Error: files of
// the folder are missing or damaged (failed), or as record_run does.
std::string import_kept(Config config, const std::string& folder, const std::string& out);

}  // namespace echofuse::acquire
