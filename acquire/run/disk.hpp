// SPDX-License-Identifier: MIT
// Checks the speed and the free space of the disk for `doctor` and at the start of a run.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

enum class Grade { ok, warning, problem };

// Result of one check by `doctor`.
struct Finding {
  std::string check;  // name of the check, e.g. "radar" or "disk rate"
  Grade grade = Grade::ok;
  std::string found;
  std::string advice{};  // recommended action; may be empty
  std::vector<std::pair<std::string, double>>
      // Names (with units) and values of the numbers in `found`.
      facts{};
  ExitCode failure = ExitCode::device;  // exit code if the grade is `problem`
};

struct PlannedRun {
  std::string folder{};
  double record_bytes = 0;  // size of the sensor data per record, bytes; 0: unknown
  double window_s = 0;
  std::optional<std::int64_t> count{};
};

struct DiskEstimate {
  double record_bytes = 0;  // size of the sensor data, row and events of a record, bytes
  // Total size of all planned records in bytes; 0 if the number of records is unlimited.
  double needed_bytes = 0;
  double lasts_s = 0;  // recording time until the disk is full
};
// Requires `plan.record_bytes` > 0.
DiskEstimate estimate_disk(const PlannedRun& plan, double free_bytes);

// Returns the free space of the folder's file system in bytes; no value if unknown.
std::optional<std::uint64_t> free_bytes(const std::string& folder);

// Formats a size, e.g. "12 kB".
std::string size_text(double bytes);

struct DiskSpeed {
  double bytes_per_s = 0;
  double commit_median_s = 0, commit_longest_s = 0;
  std::size_t commit_bytes = 0;
};

// Writes blocks of `commit_bytes` to an unnamed file in the folder for about one second. Calls
// fdatasync after each block, because a run also calls it at each commit. Throws Error(disk) on
// failure.
DiskSpeed measure_disk(const std::string& folder, std::size_t commit_bytes);

Finding speed_finding(const DiskSpeed& speed, const PlannedRun& plan);
// Returns a problem if the planned records need more space than is free. If the number of records
// is unlimited, returns a warning if the free space lasts for less than `short_s` seconds.
Finding space_finding(double free_bytes, const PlannedRun& plan, double short_s = 3600);

// Checks the speed and the free space of the disk. If the record size is unknown, only reports the
// measured values.
std::vector<Finding> check_disk(const PlannedRun& plan);

}  // namespace echofuse::acquire
