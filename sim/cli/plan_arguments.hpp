// SPDX-License-Identifier: MIT
#pragma once
#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "sim/dataset/dataset.hpp"

namespace echofuse::sim {

using Command = std::function<ExitCode(bool quiet)>;

// Returns the settings of the instruments whose response (acquire/measurement/response.hpp) and
// axes this calibration file states. Throws Error(config) if it states no response.
std::vector<std::string> settings_like(const std::string& path);

// Arguments that describe a plan on the command line.
struct PlanArguments {
  std::string config, like;
  std::vector<std::string> settings;
  std::string twin;
  std::optional<std::int64_t> laboratory, laboratories;

  std::vector<std::string> assignments() const {
    std::vector<std::string> all = like.empty() ? std::vector<std::string>{} : settings_like(like);
    all.insert(all.end(), settings.begin(), settings.end());
    if (!twin.empty()) all.push_back("twin=" + twin);
    if (laboratory) all.push_back("laboratory=" + std::to_string(*laboratory));
    if (laboratories) all.push_back("laboratories=" + std::to_string(*laboratories));
    return all;
  }
};

void add_plan_options(CLI::App& app, PlanArguments& arguments);
// Returns --twin.
CLI::Option* add_twin_options(CLI::App& app, PlanArguments& arguments);

// Reads the plan for a command with one laboratory only; the conditions are as drawn. A data set's
// file can also configure a laboratory.
void read_plan(const PlanArguments& arguments, Plan& plan, Settings& settings);

}  // namespace echofuse::sim
