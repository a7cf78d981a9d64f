// SPDX-License-Identifier: MIT
// What of all that the devices sent is in no record, and why.
#pragma once
#include <array>
#include <vector>

#include "acquire/run_log.hpp"
#include "acquire/window.hpp"
#include "acquire/writer.hpp"

namespace echofuse::acquire {

// At a run's end: the drivers' counters and the strays into the run, all of them or none, and a
// warning of each kind of stray that matters.
void close_accounts(Writer& writer, RunLog& log,
                    std::array<std::vector<Counter>, sensor_count> counters, const Strays& strays);

}  // namespace echofuse::acquire
