// SPDX-License-Identifier: MIT
// One part of a job that is divided among the tasks of a cluster's job array. The number of a part
// determines its pieces, so parts do not communicate.
#pragma once
#include <cstdint>
#include <string>

namespace echofuse {

class JobPart {
 public:
  // Parses "K/N" with 1 <= K <= N <= 100000. Throws Error(usage) if the string is invalid.
  static JobPart of(const std::string& text);

  std::string name() const;  // "part-2-of-4", used in file names

  // Range [begin, end) of consecutive pieces.
  struct IndexRange {
    std::int64_t begin, end;
    std::int64_t size() const { return end - begin; }
  };
  IndexRange range(std::int64_t pieces) const;

 private:
  JobPart(std::int64_t number, std::int64_t count) : number_(number), count_(count) {}
  std::int64_t number_, count_;  // number_ starts at 1
};

inline constexpr const char* part_help =
    "process only part K of N parts, given as K/N, e.g. 3/8; in a Slurm array, use "
    "$SLURM_ARRAY_TASK_ID/N";

}  // namespace echofuse
