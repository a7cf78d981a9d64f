// SPDX-License-Identifier: MIT
// Follows a run that is being recorded.
#pragma once
#include <functional>
#include <string>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {

// Calls `take` with the run file until it is closed, or go_on() returns false. `take` returns true
// if it found a record; otherwise the next look follows after 20 ms. Opens the file for each look,
// because a run's writer leaves one single file only if no other process has it open.
void follow(const std::string& path, const std::function<bool(const RunReader&)>& take,
            const std::function<bool()>& go_on);

}  // namespace echofuse::record
