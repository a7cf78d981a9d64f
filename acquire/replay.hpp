// SPDX-License-Identifier: MIT
// The `replay` command: a recorded byte stream through the parser that live data go through.
#pragma once
#include <string>

namespace echofuse::acquire {

// Counts of a recording of the radar's data port, as JSON (one object) or text for people.
// Throws Error if the file cannot be read.
std::string replay_radar(const std::string& path, bool json);

}  // namespace echofuse::acquire
