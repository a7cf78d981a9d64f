// SPDX-License-Identifier: MIT
// The `info` command: what is in a run file, live, closed or crashed.
#pragma once
#include <string>

namespace echofuse::acquire {

// JSON (one object) or text for people. Throws Error if the file is not a readable run.
std::string describe_run(const std::string& path, bool json);

}  // namespace echofuse::acquire
