// SPDX-License-Identifier: MIT
#pragma once
#include <functional>
#include <string>

#include "acquire/record/run_reader.hpp"

namespace echofuse::record {

// Calls `take` with the run until the run is closed or go_on() returns false. `take` returns true
// if it found a record; otherwise the next call follows after 20 ms. The file is reopened for each
// call, because its writer can close the run as a single file only while no other process has the
// file open.
void follow(const std::string& path, const std::function<bool(const RunReader&)>& take,
            const std::function<bool()>& go_on);

}  // namespace echofuse::record
