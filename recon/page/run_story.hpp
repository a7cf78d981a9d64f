// SPDX-License-Identifier: MIT
// A run as it was recorded, whatever a model makes of it: what was there when, and what was lost.
#pragma once
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "recon/page/page.hpp"

namespace echofuse::recon {

struct RunStory {
  std::string path;
  record::RunInfo info;
  record::RunSummary summary;
  std::vector<record::Event> events;
  std::vector<record::FusedRecord> outlines;  // without the sensors' data
};

RunStory story_of(const std::string& path);  // throws as RunReader
// "complete: 20 records, of which 19 have all three sensors".
std::string verdict_of(const RunStory& story);
// It says which sensors are missing for good, or in many records: a sentence each.
std::vector<std::string> gone_sensors(const RunStory& story);
// Blocks of a page: tables, and strips over the run; `between`: blocks after the verdict.
Json story_blocks(const RunStory& story, const Json& between);

}  // namespace echofuse::recon
