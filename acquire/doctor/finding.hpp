// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "drivers/program/exit_code.hpp"

namespace echofuse::acquire {

enum class Grade { ok, warning, problem };

// What one check of the doctor saw.
struct Finding {
  std::string check;  // "radar", "disk rate"
  Grade grade = Grade::ok;
  std::string found;
  std::string advice{};  // what to do; empty if nothing
  std::vector<std::pair<std::string, double>>
      facts{};                          // the numbers of `found`, units in the names
  ExitCode failure = ExitCode::device;  // what a problem makes of the exit code
};

}  // namespace echofuse::acquire
