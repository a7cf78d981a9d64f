// SPDX-License-Identifier: MIT
// Compares a new calibration with the one in run.calibration, and writes it.
#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/config/calibration.hpp"

namespace echofuse::acquire {

// Prints the residuals unless `quiet`, and adds them to the JSON. Returns false if one exceeds
// three standard errors.
bool compare(const Calibration& fresh, const Calibration& stored, nlohmann::ordered_json& json,
             bool quiet);

// Reads the calibration file; empty if it is missing. Throws Error(config) if the file is
// unreadable, because such a file is not overwritten.
Calibration stored_in(const std::string& path);

// Writes the new calibration over the stored one and prints the sensors that keep the old one.
void store(const Calibration& fresh, const Calibration& stored, const std::string& path,
           nlohmann::ordered_json& json, bool quiet);

}  // namespace echofuse::acquire
