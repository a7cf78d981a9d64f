// SPDX-License-Identifier: MIT
// What of all that the devices sent is in no record, and why.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/run_log.hpp"
#include "acquire/window.hpp"
#include "acquire/writer.hpp"

namespace echofuse::acquire {

// At a run's end: the drivers' counters and the strays into the run, all of them or none, and a
// warning of each kind of stray that matters.
void close_accounts(Writer& writer, RunLog& log, PerSensor<std::vector<Counter>> counters,
                    const Strays& strays);

// "7 records", "3 of 3 records, 23 in all": of `planned` ones, and of a resumed run with `before`.
std::string count_text(std::int64_t written, std::optional<std::int64_t> planned,
                       std::optional<std::int64_t> before);

}  // namespace echofuse::acquire
