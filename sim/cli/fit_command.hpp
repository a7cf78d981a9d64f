// SPDX-License-Identifier: MIT
#pragma once
#include "sim/cli/plan_arguments.hpp"

namespace echofuse::sim {

void add_fit(CLI::App& app, Command& command);

}  // namespace echofuse::sim
