// SPDX-License-Identifier: MIT
// What there is to say of each run of a folder, for `list` and for the viewer.
#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {

struct RunEntry {
  std::string path;
  RunInfo info;
  RunSummary sum;
  std::vector<std::string> notes;

  std::string name() const;  // of the file, without its extension
  double length_s() const;   // from the first slot's start to the last one's end
};

RunEntry entry_of(const RunReader& run);
// Where the next entry is a later part of the same run, its numbers join this one, which becomes
// that of the whole: true.
bool join_part(RunEntry& entry, const RunEntry& next);

// An object with name, path, started_utc, length_s, records, status, valid, doubtful, verdict,
// labels, operator, notes, window_s.
nlohmann::ordered_json to_json(const RunEntry& entry);

// The run files (*.sqlite) of a folder, by their place: the path without "." and links in it.
// Throws Error(failed) if the folder cannot be read.
std::map<std::string, std::string> run_files(const std::string& folder);
std::string place_of(const std::string& path);

}  // namespace echofuse::record
