// SPDX-License-Identifier: MIT
// Calibration file (TOML), written by `calibrate` and named by run.calibration. Has a section a
// ranging sensor: by how much its ranges are too long. Section antennas: gain and phase that each
// of the radar's antennas adds. Section response: how the sensors respond to a point
// (acquire/measurement/response.hpp). Section axes: the axes on which they record; keys are those
// of echofuse-sim. Older files are without the last three.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "acquire/measurement/response.hpp"
#include "acquire/record/record.hpp"
#include "drivers/core/axis.hpp"

namespace echofuse::acquire {

// Gains in the order of the heat map, relative to antenna 0; empty: not measured. The standard
// error is in radians for the phase and a share for the gain, because noise is alike in both.
struct AntennaGains {
  std::string date_utc;
  double distance_m = 0;
  double sine = 0;  // sine of the reflector's direction, positive to the right
  std::vector<double> gain, phase_rad, standard_error;

  bool empty() const { return gain.empty(); }
};

// Axes of the calibrated sensors; 0 for a sensor that is not calibrated.
struct CalibratedAxes {
  double bin_width_ps = 0, first_bin_ps = 0, radar_step_m = 0;
  std::int64_t bins = 0, radar_bins = 0;

  bool operator==(const CalibratedAxes&) const = default;
};

inline constexpr double most_baseline_m = 10;

struct Calibration {
  std::vector<record::CalibrationEntry> entries;  // one or both ranging sensors
  std::optional<FirmwareBias> firmware;
  AntennaGains antennas;
  record::Response response;
  CalibratedAxes axes = {};
  double baseline_m = 0;  // radar.baseline_m when the radar was measured; 0: not stated

  const record::CalibrationEntry* find(Sensor sensor) const;  // null: none
  // Returns this calibration, completed from `older`.
  Calibration over(const Calibration& older) const;
};

struct Config;
// Those of a run with these instruments, of the sensors that are calibrated. `radar`: the device's.
CalibratedAxes axes_of(const Config& config, const Calibration& calibration, const Axis& radar);

// Throws Error(config) with all faults, file:line each.
Calibration read_calibration(const std::string& path);
// Replaces the file as a whole. Throws Error(disk).
void write_calibration(const std::string& path, const Calibration& calibration);

}  // namespace echofuse::acquire
