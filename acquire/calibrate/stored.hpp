// SPDX-License-Identifier: MIT
// A fresh calibration against the one that run.calibration holds.
#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "acquire/config/calibration.hpp"

namespace echofuse::acquire {

// Prints the residuals unless `quiet`, and adds them to the JSON. False: one is more than three of
// its standard errors.
bool compare(const Calibration& fresh, const Calibration& stored, nlohmann::ordered_json& json,
             bool quiet);

// Calibration that the file holds already; empty without the file. Throws Error(config) for one
// that cannot be read, because it is never overwritten unread.
Calibration stored_in(const std::string& path);

// Writes the fresh calibration over the stored one, and reports which sensors keep theirs.
void store(const Calibration& fresh, const Calibration& stored, const std::string& path,
           nlohmann::ordered_json& json, bool quiet);

}  // namespace echofuse::acquire
