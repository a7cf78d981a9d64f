// SPDX-License-Identifier: MIT
// The calibration file (TOML, one section a ranging sensor), written by `calibrate` and named by
// run.calibration: by how much each sensor's ranges are too long, what each of the radar's antennas
// adds to its samples (section antennas), how the sensors respond to a point (section response,
// acquire/measurement/response.hpp), and on which axes they record (section axes, whose keys are
// those of echofuse-sim); files of before are without the last three.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "acquire/measurement/response.hpp"
#include "acquire/record/record.hpp"

namespace echofuse::acquire {

// In the order of the heat map, relative to antenna 0; empty: not measured. The standard error is
// that of the phase in radians, and of the gain as a share of it: noise is alike in both.
struct AntennaGains {
  std::string date_utc;
  double distance_m = 0;
  std::vector<double> gain, phase_rad, standard_error;

  bool empty() const { return gain.empty(); }
};

// All numbers are 0 for a sensor that is not calibrated.
struct CalibratedAxes {
  double bin_width_ps = 0, first_bin_ps = 0, radar_step_m = 0;
  std::int64_t bins = 0, radar_bins = 0;

  bool operator==(const CalibratedAxes&) const = default;
};

struct Calibration {
  std::vector<record::CalibrationEntry> entries;  // one or both ranging sensors
  std::optional<FirmwareBias> firmware;
  AntennaGains antennas;
  record::Response response;
  CalibratedAxes axes = {};

  const record::CalibrationEntry* find(Sensor sensor) const;  // null: none
  // All that this one has, and of `older` the rest.
  Calibration over(const Calibration& older) const;
};

struct Config;
// Those of a run with these instruments, of the sensors that are calibrated.
CalibratedAxes axes_of(const Config& config, const Calibration& calibration);

// Throws Error(config) with all faults, file:line each.
Calibration read_calibration(const std::string& path);
// Replaces the file as a whole. Throws Error(disk).
void write_calibration(const std::string& path, const Calibration& calibration);

}  // namespace echofuse::acquire
