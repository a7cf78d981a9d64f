// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

#include "drivers/program/exit_code.hpp"
#include "sim/lab/lab.hpp"

namespace echofuse::sim {

// Serves while the command runs. The command sees the laboratory's devices and has the programs
// beside this one on its path; it gets SIGTERM and the first SIGINT. Returns its exit code, or 128
// + N if signal N ended it. Throws Error(failed) if the command cannot be started.
ExitCode serve_command(Lab& lab, const std::vector<std::string>& command, bool quiet = false);

}  // namespace echofuse::sim
