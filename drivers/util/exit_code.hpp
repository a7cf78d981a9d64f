// SPDX-License-Identifier: MIT
// Exit codes of all programs, and the exception that passes an exit code to main.
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
  partial = 5,  // the job finished, but some of its parts failed
  disk = 6,
  interrupted = 130,
};

// Thrown at start-up and by batch programs; caught only by main. The message has one line per
// fault. Each line contains the location (file, line or key), the fault and the expected value.
class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& text) : std::runtime_error(text), code_(code) {}
  ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

}  // namespace echofuse
