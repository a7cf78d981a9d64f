// SPDX-License-Identifier: MIT
// The `calibrate` command: measures range offsets, antenna phases and responses with a reflector at
// a known distance.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "acquire/calibrate/antenna_side.hpp"
#include "acquire/calibrate/peak.hpp"
#include "acquire/calibrate/reflector.hpp"
#include "acquire/config/config.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

struct CalibrateOptions {
  Search search;
  bool distance_given = false;
  Mounting mounting = Mounting::detector;
  double distance_error_m = Reflector().distance_error_m;
  double baseline_error_m = Reflector().baseline_error_m;
  std::optional<Sensor> only;  // sensor to measure; no value: both sensors
  // Side to which the reflector has been moved. If set, only checks whether the antenna order is
  // reversed.
  std::optional<Side> side;
  std::int64_t repeats = 20;
  double time_s = 1;   // duration of each repeat
  bool check = false;  // if true, compares the results with run.calibration and writes nothing
  bool json = false;
};

// Measures the sensors and writes their calibration to config.calibration_path. Entries of other
// sensors in that file are kept. Returns ExitCode::device if a sensor could not be measured. If
// `check` is set, writes nothing and returns ExitCode::failed if a sensor differs from its stored
// calibration by more than three standard errors. If `side` is set, returns ExitCode::failed if the
// antenna order is reversed. Throws Error(config) before the measurement if the file exists but is
// unreadable.
ExitCode calibrate(const Config& config, const CalibrateOptions& options, port::Loop& loop);

}  // namespace echofuse::acquire
