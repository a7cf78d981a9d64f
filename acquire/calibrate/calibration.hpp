// SPDX-License-Identifier: MIT
// The calibration file (TOML, one section a ranging sensor), written by `calibrate` and named by
// run.calibration: by how much each sensor's ranges are too long, what each of the radar's antennas
// adds to its samples (section antennas), and how the sensors respond to a point (section response,
// acquire/record/response.hpp); files of before are without the last two.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "acquire/calibrate/array_calibration.hpp"
#include "acquire/record/record.hpp"
#include "acquire/record/response.hpp"

namespace echofuse::acquire {

struct Calibration {
  std::vector<record::CalibrationEntry> entries;  // of one or both ranging sensors
  std::optional<FirmwareBias> firmware;
  AntennaGains antennas;
  record::Response response;

  const record::CalibrationEntry* find(Sensor sensor) const;  // null: none
  // All that this one has, and of `older` the rest.
  Calibration over(const Calibration& older) const;
};

// Throws Error(config) with all faults, file:line each.
Calibration read_calibration(const std::string& path);
// Replaces the file as a whole. Throws Error(disk).
void write_calibration(const std::string& path, const Calibration& calibration);

}  // namespace echofuse::acquire
