// SPDX-License-Identifier: MIT
#pragma once
#include <string>

namespace echofuse::sim {

// Has gnuplot draw, with `folder` as its own. Throws Error(failed) if it is not there, or does not
// understand the script; `without` says what the user has all the same.
void run_gnuplot(const std::string& script, const std::string& folder, const std::string& without);

}  // namespace echofuse::sim
