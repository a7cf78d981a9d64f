// SPDX-License-Identifier: MIT
// Compares a new calibration with the calibration file run.calibration, and writes it to that file.
#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/config/calibration.hpp"

namespace echofuse::acquire {

// Prints the differences between the two calibrations unless `quiet` is set, and adds them to the
// JSON. Returns false if a difference exceeds three standard errors (four for antennas).
bool compare(const Calibration& fresh, const Calibration& stored, nlohmann::ordered_json& json,
             bool quiet);

// Reads the calibration file; returns an empty calibration if it is missing. Throws Error(config)
// if the file exists but is unreadable, so that store() does not overwrite it.
Calibration stored_in(const std::string& path);

// Writes the new calibration. Keeps the stored entries of sensors that were not measured, and
// prints these entries unless `quiet` is set.
void store(const Calibration& fresh, const Calibration& stored, const std::string& path,
           nlohmann::ordered_json& json, bool quiet);

}  // namespace echofuse::acquire
