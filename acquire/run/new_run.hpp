// SPDX-License-Identifier: MIT
// The file of a new run.
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

// Throws Error: `out` exists (failed), its folder does not or cannot be written (disk).
void refuse_bad_target(const std::filesystem::path& out);
// Throws Error(failed): a run that begins at this time comes too near to 2262, where UtcTime ends.
void refuse_late_clock(UtcTime now);

// Makes a run file with the calibration and antennas of the configuration. `clock` outlives the
// writer. An empty uuid: a new one.
std::unique_ptr<record::RunWriter> make_run(
    const Config& config, const std::string& out,
    const std::vector<std::pair<std::string, std::string>>& meta, const std::string& uuid,
    const Clock& clock);

}  // namespace echofuse::acquire
