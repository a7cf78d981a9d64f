// SPDX-License-Identifier: MIT
// Prints the results of `calibrate` as text and as JSON.
#pragma once
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/calibrate/array_calibration.hpp"
#include "acquire/calibrate/peak.hpp"
#include "acquire/measurement/response.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

struct CalibrationResult {
  Sensor sensor{};
  Peak peak;            // fitted to all repeats together
  double spread_m = 0;  // standard deviation of the repeats
  std::string method;
};

// Response as a run would state it, or the reason why it cannot.
using Unstated = std::map<std::string, std::string>;

nlohmann::ordered_json json_of(const CalibrationResult& result, const Search& search);
nlohmann::ordered_json json_of(const AntennaFit& fit);
void say(const CalibrationResult& result, const Search& search);
void say(const record::Response& response, const Unstated& unstated);

}  // namespace echofuse::acquire
