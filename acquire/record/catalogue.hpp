// SPDX-License-Identifier: MIT
// Summary of each run of a folder, for `list` and the viewer.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "acquire/record/run_reader.hpp"

namespace echofuse::record {

struct RunEntry {
  std::string path;
  RunInfo info;
  RunSummary sum;
  std::vector<std::string> notes;
  std::vector<std::string> leftovers;  // SQLite side files that were left next to a closed run

  std::string name() const;  // file name without extension
  double length_s() const;   // time from the start of the first slot to the end of the last slot
};

RunEntry entry_of(const RunReader& run);

// Returns a JSON object with name, path, started_utc, length_s, records, status, valid, doubtful,
// verdict, labels, operator, notes, window_s, leftovers.
nlohmann::ordered_json to_json(const RunEntry& entry);

// Returns the sorted paths of the run files (*.sqlite) in a folder. Throws Error(failed) if the
// folder cannot be read.
std::vector<std::string> run_files(const std::string& folder);

}  // namespace echofuse::record
