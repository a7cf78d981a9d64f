// SPDX-License-Identifier: MIT
// What a fit estimates: the default twin's keys, and ratios of them.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "sim/fit/fit.hpp"

namespace echofuse::sim {

// radar_cloth is 1; reflectivities, leakage and noise of the radar are of it.
Conditions in_units_of_cloth(Conditions c);

// Of all numbers of the conditions in these units, and of the ratios.
std::map<std::string, double> quantities_of(const Conditions& c);
std::vector<Estimate> all_quantities(const Twin& prior);
std::string meaning_of(const std::string& name);  // of a ratio; with unit
std::string reason_of(const std::string& name);   // why a run may not tell it

// Ranges of what is told: the estimate +- so many standard errors; the prior's of everything else.
// radar_cloth is 1.
Twin narrowed(const Twin& prior, const std::vector<Estimate>& estimates, double standard_errors);

}  // namespace echofuse::sim
