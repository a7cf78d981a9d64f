// SPDX-License-Identifier: MIT
// The `info` command: what is in a run, live, closed or crashed.
#pragma once
#include <string>
#include <vector>

namespace echofuse::acquire {

// JSON (one object) or text for people, of one file or of the parts of a run in their order. Throws
// Error if one is not a readable run.
std::string describe_run(const std::vector<std::string>& files, bool json);

}  // namespace echofuse::acquire
