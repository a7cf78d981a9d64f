// SPDX-License-Identifier: MIT
// Part of a work that the tasks of a cluster's job array share. A part's number alone gives its
// pieces, so that no part needs to know of another.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/program/exit_code.hpp"

namespace echofuse {

class JobPart {
 public:
  // "K/N", 1 <= K <= N <= 100000. Throws Error(usage).
  static JobPart of(const std::string& text);

  std::string name() const;  // "part-2-of-4", of files

  // Pieces in a row: [begin, end).
  struct Range {
    std::int64_t begin, end;
    std::int64_t size() const { return end - begin; }
  };
  Range range(std::int64_t pieces) const;

  // Marks the pieces of this part; `work` is each piece's cost in any unit. A part's pieces follow
  // each other, because neighbours may need the same records. Parts have about equal work.
  std::vector<bool> share(const std::vector<double>& work) const;

 private:
  JobPart(std::int64_t number, std::int64_t count) : number_(number), count_(count) {}
  std::int64_t number_, count_;  // from 1
};

// Help of the option --part.
inline constexpr const char* part_help =
    "K/N: only the K-th of N parts of the work; in a Slurm array $SLURM_ARRAY_TASK_ID/N";

// Throws Error(code): this line of the head of a part's file is not the expected one.
[[noreturn]] void refuse_part(ExitCode code, const std::string& path, const std::string& line,
                              const std::string& expected);

// The files FOLDER/STEMpart-K-of-N.EXTENSION, in the order of their names; none of a folder that is
// not there.
std::vector<std::string> part_files(const std::string& folder, const std::string& stem,
                                    const std::string& extension);

}  // namespace echofuse
