// SPDX-License-Identifier: MIT
// The exit codes of all three programs, and the exception that carries one to main.
#pragma once
#include <stdexcept>
#include <string>

namespace echofuse {

enum class ExitCode : int {
  ok = 0,
  failed = 1,
  usage = 2,
  config = 3,
  device = 4,
  partial = 5,  // the job finished, but some of its parts were bad
  disk = 6,
  interrupted = 130,
};

// Thrown at start-up and in batch programs; only main catches it. The text is one clear line: the
// file, line or key, what was wrong, what would be right. Several faults at once make several
// lines.
class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& text) : std::runtime_error(text), code_(code) {}
  ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

}  // namespace echofuse
