// SPDX-License-Identifier: MIT
#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/record/run_writer.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Throws Error(failed) if `out` exists, or Error(disk) if its folder is missing or not writable.
void refuse_bad_target(const std::filesystem::path& out);
// Throws Error(failed) if `now` is less than three years before the end of UtcTime's range (2262).
void refuse_late_clock(UtcTime now);

// Returns the metadata with those entries of the calibrated response that `meta` does not contain.
std::vector<std::pair<std::string, std::string>> complete_meta(
    std::vector<std::pair<std::string, std::string>> meta, const Config& config);

// Creates a run file and writes the calibration and antennas of the configuration to it. `clock`
// must outlive the writer. If `uuid` is empty, a random UUID is used.
std::unique_ptr<record::RunWriter> make_run(
    const Config& config, const std::string& out,
    const std::vector<std::pair<std::string, std::string>>& meta, const std::string& uuid,
    const Clock& clock);

}  // namespace echofuse::acquire
