// SPDX-License-Identifier: MIT
// The `calibrate` command: measures a reflector at a known distance with the drivers of a run.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "acquire/calibrate/peak.hpp"
#include "acquire/calibrate/reflector.hpp"
#include "acquire/calibrate/side.hpp"
#include "acquire/config/config.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

struct CalibrateOptions {
  Search search;  // distance of the reflector from the sensor behind it
  Mounting mounting = Mounting::detector;
  double distance_error_m = Reflector().distance_error_m;
  double baseline_error_m = Reflector().baseline_error_m;
  std::optional<Sensor> only;  // measure this sensor alone
  std::optional<Side> side;    // check only for a swapped antenna row
  std::int64_t repeats = 20;
  double time_s = 1;   // per repeat
  bool check = false;  // compare with run.calibration; do not write it
  bool json = false;
};

// Writes the measured sensors to config.calibration_path and keeps the file's entries of the
// others. Returns the device code if a sensor could not be measured. With `check`: failed if a
// sensor differs by more than three standard errors. With `side`: failed if the antenna row is
// swapped. Throws Error(config) before the measurement if the file exists but is unreadable.
ExitCode calibrate(const Config& config, const CalibrateOptions& options, port::Loop& loop);

}  // namespace echofuse::acquire
