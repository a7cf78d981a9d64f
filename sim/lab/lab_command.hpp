// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

#include "drivers/program/exit_code.hpp"
#include "sim/lab/lab.hpp"

namespace echofuse::sim {

// It serves as long as the command runs. The command sees the laboratory's devices, and the
// programs beside this one are on its path. SIGTERM and the first SIGINT go on to it. It returns
// the command's exit code, or 128 + N if signal N ended it. Throws Error(failed) if the command
// cannot be started.
ExitCode serve_command(Lab& lab, const std::vector<std::string>& command, bool quiet = false);

}  // namespace echofuse::sim
