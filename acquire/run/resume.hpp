// SPDX-License-Identifier: MIT
// The file of a run: a new one, or one to continue, and what must be the same for that.
#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Throws Error(config) that names the keys whose values differ from those that the run was begun
// with. May differ: run.label, run.operator, run.connect_timeout_s, baud rates, radar.keep_running,
// radar.board, and where a device is attached (not whether there is one). The radar cfg counts by
// its text, the calibration by its entries, `calibrated` in the run; neither by its name.
void refuse_other_config(const record::RunInfo& begun,
                         const std::vector<record::CalibrationEntry>& calibrated,
                         const Config& config);

// Throws Error(config) if the radar's antennas, their places, gains or phases, are others.
void refuse_other_antennas(const record::Antennas& begun, const Config& config);

// Throws Error(config) if a device's axis is not the one of that name in the run.
void refuse_other_axes(const std::vector<Axis>& begun, const DeviceInfo& device);

// Throws Error: `out` exists (failed), its folder does not or cannot be written (disk).
void refuse_bad_target(const std::filesystem::path& out);
// Throws Error(failed): a run that begins at this time comes too near to 2262, where UtcTime ends.
void refuse_late_clock(UtcTime now);
// Throws Error: it is being recorded (failed) or cannot be written (disk), or refuse_other_config
// or refuse_other_antennas does.
void refuse_resuming(const record::RunReader& begun, const Config& config);

// Makes a run file with the calibration and antennas, which a resumed run must not change. `clock`
// outlives the writer. An empty uuid: a new one.
std::unique_ptr<record::RunWriter> make_run(
    const Config& config, const std::string& out,
    const std::vector<std::pair<std::string, std::string>>& meta, const std::string& uuid,
    const Clock& clock);

// State from which a run goes on; default values for a new run.
struct Resumption {
  std::unique_ptr<record::RunWriter> file;
  std::vector<Axis> axes;                       // axes of the run's start
  std::int64_t first_index = 0;                 // next record's index: slots are counted from here
  std::int64_t part_records = 0, part_end = 0;  // records a part, next part's first; 0: one file
  std::optional<std::int64_t> records_before;
  std::string gap;                   // the event that notes the resumption
  std::optional<std::string> label;  // its last one
};
// Throws Error(failed) if another one continued it meanwhile, or as RunWriter or `look` does.
Resumption reopen_run(const std::string& out, const Clock& clock,
                      const record::RunWriter::Look& look = {});

}  // namespace echofuse::acquire
