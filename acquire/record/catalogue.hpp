// SPDX-License-Identifier: MIT
// Facts of each run of a folder, for `list` and for the viewer.
#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "acquire/record/run_parts.hpp"

namespace echofuse::record {

struct RunEntry {
  std::string path;                // NAME.sqlite for a run in parts
  std::vector<std::string> files;  // parts in order
  Part part;                       // the last one
  std::string missing;             // parts that are not there, a line for each gap
  RunInfo info;
  RunSummary sum;
  std::vector<std::string> notes;

  std::string name() const;  // file name without extension
  double length_s() const;   // from the first slot's start to the last one's end
};

RunEntry entry_of(const RunReader& run);  // without the other parts
// The runs of these files, which stand as in run_files(): the parts of one join, and what is named
// like a part of another run stays by itself.
std::vector<RunEntry> runs_of(std::vector<RunEntry> files);

// An object with name, path, started_utc, length_s, records, status, valid, doubtful, verdict,
// labels, operator, notes, window_s.
nlohmann::ordered_json to_json(const RunEntry& entry);

// Sorting key: absolute path without "." and links, then the part number, so that parts stand
// together.
using Place = std::pair<std::string, std::int64_t>;
Place place_of(const std::string& path);
// The run files (*.sqlite) of a folder. Throws Error(failed) if the folder cannot be read.
std::map<Place, std::string> run_files(const std::string& folder);

}  // namespace echofuse::record
