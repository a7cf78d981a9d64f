// SPDX-License-Identifier: MIT
// The doctor's checks of the disk under a run file: fast enough, and large enough?
#pragma once
#include <string>
#include <vector>

#include "acquire/doctor/finding.hpp"
#include "acquire/run/disk_estimate.hpp"

namespace echofuse::acquire {

struct DiskSpeed {
  double bytes_per_s = 0;
  double commit_median_s = 0, commit_longest_s = 0;
  std::size_t commit_bytes = 0;
};

// Writes blocks of this size to a nameless file in the folder for about a second, each followed by
// fdatasync as the run file's commits are. Throws Error(disk).
DiskSpeed measure_disk(const std::string& folder, std::size_t commit_bytes);

Finding judge_speed(const DiskSpeed& speed, const PlannedRun& plan);
Finding judge_space(double free_bytes, const PlannedRun& plan);

// Measures and judges both; without a size of its records only the disk itself is reported.
std::vector<Finding> check_disk(const PlannedRun& plan);

}  // namespace echofuse::acquire
