// SPDX-License-Identifier: MIT
// The doctor's checks of the disk under a run file: fast enough, and large enough?
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/finding.hpp"

namespace echofuse::acquire {

// The run to come. Without a size of its records only the disk itself is told of.
struct PlannedRun {
  std::string folder;
  double record_bytes = 0;  // of the sensors' data; 0: unknown
  double window_s = 0;
  std::optional<std::int64_t> count{};
};

struct DiskSpeed {
  double bytes_per_s = 0;
  double commit_median_s = 0, commit_longest_s = 0;
  std::size_t commit_bytes = 0;
};

// Writes blocks of this size to a nameless file in the folder for about a second, each followed by
// fdatasync as the run file's commits are. Throws Error(disk).
DiskSpeed measure_disk(const std::string& folder, std::size_t commit_bytes);

Finding judge_speed(const DiskSpeed& speed, const PlannedRun& plan);
Finding judge_room(double free_bytes, const PlannedRun& plan);

// Measures and judges both.
std::vector<Finding> check_disk(const PlannedRun& plan);

}  // namespace echofuse::acquire
