// SPDX-License-Identifier: MIT
// This file says what `calibrate` has measured, to people and as JSON.
#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/calibrate/array_calibration.hpp"
#include "acquire/calibrate/peak.hpp"
#include "acquire/record/response.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

struct Result {
  Sensor sensor{};
  Peak peak;            // of all repeats together
  double spread_m = 0;  // standard deviation of the repeats
  std::string method;
};

nlohmann::ordered_json json_of(const Result& result, const Search& search);
nlohmann::ordered_json json_of(const AntennaFit& fit);
void say(const Result& result, const Search& search);
void say(const record::Response& response);

}  // namespace echofuse::acquire
