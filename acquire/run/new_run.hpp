// SPDX-License-Identifier: MIT
// Creates the file of a new run.
#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Throws Error(failed) if `out` exists, Error(disk) if its folder is missing or not writable.
void refuse_bad_target(const std::filesystem::path& out);
// Throws Error(failed) if this time is too close to 2262, the end of UtcTime's range.
void refuse_late_clock(UtcTime now);

// Creates a run file with the calibration and antennas of the configuration. `clock` must outlive
// the writer. Empty uuid: random.
std::unique_ptr<record::RunWriter> make_run(
    const Config& config, const std::string& out,
    const std::vector<std::pair<std::string, std::string>>& meta, const std::string& uuid,
    const Clock& clock);

}  // namespace echofuse::acquire
