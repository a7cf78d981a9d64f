// SPDX-License-Identifier: MIT
// Prints the results of `calibrate` as text and as JSON.
#pragma once
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/calibrate/array_calibration.hpp"
#include "acquire/calibrate/peak.hpp"
#include "acquire/calibrate/response_fit.hpp"
#include "acquire/measurement/response.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

struct CalibrationResult {
  Sensor sensor{};
  Peak peak;
  double spread_m = 0;  // standard deviation of the ranges measured in the repeats
  std::string method;
  double true_range_m = 0;
  double reflector_error_m = 0;  // standard error of the reflector's true range

  double offset_m() const { return peak.range_m - true_range_m; }
  double standard_error_m() const { return std::hypot(peak.standard_error_m, reflector_error_m); }
};

// Maps the name of each value that could not be measured to the reason.
using Unstated = std::map<std::string, std::string>;

nlohmann::ordered_json json_of(const CalibrationResult& result);
nlohmann::ordered_json json_of(const AntennaFit& fit);
void print_text(const CalibrationResult& result);
nlohmann::ordered_json json_of(const WindowFit& fit);
// Prints the asymmetry of the radar response if it is significant.
void print_text(const WindowFit& fit);
void print_text(const record::Response& response, const Unstated& unstated);

}  // namespace echofuse::acquire
