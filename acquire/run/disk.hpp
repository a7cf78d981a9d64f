// SPDX-License-Identifier: MIT
// Space and speed of the disk of a run file, for `doctor` and the start of a run.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/zone.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

enum class Grade { ok, warning, problem };

// Result of one check of the doctor.
struct Finding {
  std::string check;  // "radar", "disk rate"
  Grade grade = Grade::ok;
  std::string found;
  std::string advice{};  // recommended action; may be empty
  std::vector<std::pair<std::string, double>>
      facts{};                          // numbers in `found`, with units in their names
  ExitCode failure = ExitCode::device;  // exit code of a problem
};

// Planned run.
struct PlannedRun {
  std::string folder{};
  double record_bytes = 0;  // bytes of the sensors' data; 0: unknown
  double window_s = 0;
  std::optional<std::int64_t> count{};
};

struct DiskEstimate {
  double record_bytes = 0;  // bytes per record, including its row and its share of the events
  double needed_bytes = 0;  // bytes of the planned records; 0: no number planned
  double lasts_s = 0;       // recording time until the disk is full
};
// Requires a known plan.record_bytes.
DiskEstimate estimate_disk(const PlannedRun& plan, double free_bytes);

// Returns the bytes of one record's data with these axes. Assumes uncompressed depth maps, so it
// overestimates.
double record_bytes(const std::vector<Axis>& axes, const Zones& zones);

// Returns the free bytes of the file system of this folder; nothing if unknown.
std::optional<std::uint64_t> free_bytes(const std::string& folder);

// "12 kB"
std::string size_text(double bytes);

struct DiskSpeed {
  double bytes_per_s = 0;
  double commit_median_s = 0, commit_longest_s = 0;
  std::size_t commit_bytes = 0;
};

// Writes blocks of this size to an unnamed file in the folder for about one second. Each is
// followed by fdatasync, like the commits of a run file. Throws Error(disk).
DiskSpeed measure_disk(const std::string& folder, std::size_t commit_bytes);

Finding speed_finding(const DiskSpeed& speed, const PlannedRun& plan);
// Returns a problem if the planned records need more space; without a number of records a warning
// if the space lasts less than `short_s`.
Finding space_finding(double free_bytes, const PlannedRun& plan, double short_s = 3600);

// Measures and judges both. If the record size is unknown, only describes the disk.
std::vector<Finding> check_disk(const PlannedRun& plan);

}  // namespace echofuse::acquire
