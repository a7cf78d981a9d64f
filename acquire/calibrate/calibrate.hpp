// SPDX-License-Identifier: MIT
// The `calibrate` command: a reflector at a known distance, seen through the same drivers as a run.
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
  Search search;  // distance from the sensor in front of which the reflector is
  Mounting mounting = Mounting::detector;
  double distance_error_m = Reflector().distance_error_m;
  double baseline_error_m = Reflector().baseline_error_m;
  std::optional<Sensor> only;  // measure this sensor alone
  std::optional<Side> side;    // measure nothing but on which side the radar sees the reflector
  std::int64_t repeats = 20;
  double time_s = 1;   // one repeat's length
  bool check = false;  // measure, and compare with what run.calibration says
  bool json = false;
};

// Writes the sensors that could be measured into config.calibration_path, and keeps what the file
// says of the others; device code if one could not. With `check`: failed if a sensor is off by more
// than three standard errors of the difference. Throws Error(config) before it measures: the file
// is there and cannot be read. With `side`: failed if the antenna row is swapped.
ExitCode calibrate(const Config& config, const CalibrateOptions& options, port::Loop& loop);

}  // namespace echofuse::acquire
