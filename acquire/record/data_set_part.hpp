// SPDX-License-Identifier: MIT
// How the parts of one data set are known: they have its uuid, which follows from what it is made
// of, and its number of records among their metadata.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {

// The key of the metadata: of how many records a part's data set is.
inline constexpr const char* part_of_key = "part_of_records";

// What ranges and angles of a run are corrected by. Of the parts of a data set it is one and the
// same, as the whole has it once.
struct Corrections {
  explicit Corrections(const RunReader& run)
      : offsets(run.calibrations()), antennas(run.antennas()) {}
  bool operator==(const Corrections&) const = default;

  std::vector<CalibrationEntry> offsets;
  Antennas antennas;
};

// The uuid (RFC 9562 version 8) of the data set that this configuration and version make; `files`:
// what is in the files that the configuration names.
std::string data_set_uuid(const RunInfo& info, const std::string& files);

// Of its first record; 0 if it has none.
std::int64_t first_index(const RunReader& run);

// Of how many records the data set is that this run is a part of; none if it is no part.
std::optional<std::int64_t> part_of_records(const RunInfo& info);

}  // namespace echofuse::record
