// SPDX-License-Identifier: MIT
// A run as it was recorded, whatever a model makes of it: what was there when, and what was lost.
#pragma once
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "drivers/chart/chart.hpp"

namespace echofuse::recon {

struct RunStory {
  std::string path;
  record::RunInfo info;
  record::RunSummary summary;
  std::vector<record::Event> events;
  std::vector<record::RecordOutline> outlines;
};

RunStory story_of(const std::string& path);  // throws as RunReader
// "complete: 20 records, of which 19 have all three sensors".
std::string verdict_of(const RunStory& story);
// Which sensors are missing for good, or in many records: a sentence each.
std::vector<std::string> gone_sensors(const RunStory& story);
// Strips over one axis of time: samples a record, losses, clock residuals. Of a run with records.
chart::Drawing timeline(const RunStory& story, double width);
// Tables and timeline; `between`: HTML after the verdict.
std::string story_html(const RunStory& story, const std::string& between = {});

}  // namespace echofuse::recon
