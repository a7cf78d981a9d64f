// SPDX-License-Identifier: MIT
// The disk under a run file: large enough, as `doctor` and a run's start ask, and fast enough?
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/zone.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::acquire {

enum class Grade { ok, warning, problem };

// Result of one check of the doctor.
struct Finding {
  std::string check;  // "radar", "disk rate"
  Grade grade = Grade::ok;
  std::string found;
  std::string advice{};  // text to act on; empty: none
  std::vector<std::pair<std::string, double>>
      facts{};                          // the numbers of `found`, units in the names
  ExitCode failure = ExitCode::device;  // exit code of a problem
};

// The run to come.
struct PlannedRun {
  std::string folder{};
  double record_bytes = 0;  // bytes of the sensors' data; 0: unknown
  double window_s = 0;
  std::optional<std::int64_t> count{};
};

struct DiskEstimate {
  double record_bytes = 0;  // bytes of one record with its row and its share of the events
  double needed_bytes = 0;  // bytes of the planned records; 0: no count planned
  double lasts_s = 0;       // how long the run can record until the disk is full
};
// `plan.record_bytes` is known.
DiskEstimate estimate_disk(const PlannedRun& plan, double free_bytes);

// Bytes of one record's data with these axes, depth maps as if PNG did not shrink them: rather too
// many.
double record_bytes(const std::vector<Axis>& axes, const Zones& zones);

// Free bytes of the file system that holds this folder; none if it does not tell.
std::optional<std::uint64_t> free_bytes(const std::string& folder);

// "12 kB"
std::string size_text(double bytes);

struct DiskSpeed {
  double bytes_per_s = 0;
  double commit_median_s = 0, commit_longest_s = 0;
  std::size_t commit_bytes = 0;
};

// Writes blocks of this size to a nameless file in the folder, for about a second. Each is followed
// by fdatasync, as the run file's commits are. Throws Error(disk).
DiskSpeed measure_disk(const std::string& folder, std::size_t commit_bytes);

Finding judge_speed(const DiskSpeed& speed, const PlannedRun& plan);
// A problem if the planned records need more; without a count a warning if the space does not last
// `short_s`.
Finding judge_space(double free_bytes, const PlannedRun& plan, double short_s = 3600);

// Measures and judges both; without a size of its records only the disk itself is reported.
std::vector<Finding> check_disk(const PlannedRun& plan);

}  // namespace echofuse::acquire
