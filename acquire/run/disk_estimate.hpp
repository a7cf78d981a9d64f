// SPDX-License-Identifier: MIT
// Whether a run fits its disk: the estimate of `doctor` and of a run's start.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::acquire {

// The run to come.
struct PlannedRun {
  std::string folder{};
  double record_bytes = 0;  // of the sensors' data; 0: unknown
  double window_s = 0;
  std::optional<std::int64_t> count{};
};

struct DiskEstimate {
  double record_bytes = 0;  // of a record with its row and its share of the events
  double needed_bytes = 0;  // of the planned count; 0 without one
  double lasts_s = 0;       // how long the run can record until the disk is full
};
// `plan.record_bytes` is known.
DiskEstimate estimate_disk(const PlannedRun& plan, double free_bytes);

// Bytes of one record's data with these axes, depth maps as if PNG did not shrink them: rather too
// many.
double record_bytes(const std::vector<Axis>& axes);

// Of the file system that holds this folder; none if it does not tell.
std::optional<std::uint64_t> free_bytes(const std::string& folder);

// "12 kB"
std::string size_text(double bytes);

// The warning at a run's start: more records planned than the disk takes, or, without a count,
// space for less than a day. Empty if there is enough.
std::string disk_warning(const PlannedRun& plan, double free_bytes);

}  // namespace echofuse::acquire
