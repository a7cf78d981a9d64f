// SPDX-License-Identifier: MIT
// Calibration file (TOML), written by `calibrate` and named in run.calibration. It has one section
// per ranging sensor, with the range offset (measured minus true). Section [antennas] contains the
// gain and phase errors of the radar's antennas. Section [response] contains the response of the
// sensors to a point target (acquire/measurement/response.hpp). Section [axes] contains the axes of
// the recordings, with the keys of echofuse-sim. Older files lack the last three sections.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "acquire/measurement/response.hpp"
#include "acquire/record/fused_record.hpp"
#include "drivers/core/axis.hpp"

namespace echofuse::acquire {

// Gain and phase of each antenna in the order of the heat map, relative to antenna 0; empty if not
// measured. The standard error applies to both the phase (radians) and the relative gain, because
// both have the same noise.
struct AntennaGains {
  std::string date_utc;
  double distance_m = 0;
  double sine = 0;  // sine of the reflector's angle from the radar axis, positive to the right
  std::vector<double> gain, phase_rad, standard_error;

  bool empty() const { return gain.empty(); }
};

// Axes of the sensors during the calibration; without points if a sensor is not calibrated.
struct CalibratedAxes {
  Axis spd, radar;
};

inline constexpr double max_baseline_m = 10;

struct Calibration {
  std::vector<record::CalibrationEntry> entries;  // one entry per calibrated ranging sensor
  std::optional<FirmwareBias> firmware;
  AntennaGains antennas;
  record::Response response;
  CalibratedAxes axes = {};
  double baseline_m = 0;  // value of `radar.baseline_m` during the calibration; 0 if unknown

  // Returns null if the sensor is not calibrated.
  const record::CalibrationEntry* find(Sensor sensor) const;
  // Returns a copy of this calibration; parts that it lacks are copied from `older`.
  Calibration over(const Calibration& older) const;
};

// Throws Error(config) that lists all errors, each with its line number in the file.
Calibration read_calibration(const std::string& path);
// Replaces the file atomically. Throws Error(disk) if it cannot be written.
void write_calibration(const std::string& path, const Calibration& calibration);

}  // namespace echofuse::acquire
