// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

#include "drivers/core/exit_code.hpp"
#include "sim/lab/lab.hpp"

namespace echofuse::sim {

// Serves as long as the command runs, which sees the laboratory's devices; the programs beside this
// one are on its path. SIGTERM and the first SIGINT go on to it. Its exit code; 128 + N if signal N
// ended it. Throws Error(failed) if it cannot be started.
ExitCode serve_command(Lab& lab, const std::vector<std::string>& command);

}  // namespace echofuse::sim
