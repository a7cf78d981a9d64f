// SPDX-License-Identifier: MIT
// Runs shell commands.
#pragma once
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <string>

#include "catch.hpp"
#include "paths.hpp"

namespace echofuse::test {

struct Outcome {
  int code = -1;
  std::string text;  // combined output of stdout and stderr
};

inline Outcome shell(const std::string& command) {
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  REQUIRE(pipe);
  Outcome outcome;
  std::array<char, 4096> buffer{};
  while (const auto n = std::fread(buffer.data(), 1, buffer.size(), pipe))
    outcome.text.append(buffer.data(), n);
  outcome.code = WEXITSTATUS(pclose(pipe));
  return outcome;
}

inline bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace echofuse::test
