// SPDX-License-Identifier: MIT
// A twin holds ranges of what rooms and laboratories differ in: each virtual laboratory draws its
// own.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

// A key of Conditions is uniform in [low, high], or its logarithm is.
struct Range {
  std::string key;
  double low = 0, high = 0;
  bool logarithmic = false;
};

struct Twin {
  std::int64_t seed = 1;  // another seed gives other laboratories
  std::vector<Range> ranges;
};

// The text is TOML: `key = [low, high]`, `key = [low, high, "log"]` and `seed = 1`. Throws
// Error(config) with every fault: a key that is not a real number of Conditions, that the run file
// states (axes, baseline_m) or that is there twice, and a range that is empty or outside what the
// key allows.
Twin read_twin(const std::string& text, const std::string& name);
// The text has the ranges without comments, as read_twin takes them back.
std::string to_text(const Twin& twin);
// Text of the ranges that are installed with the program (config/twin.toml), each with its source.
std::string default_twin();
// Reads a twin: `default`, the text of ranges (with a "="), or the name of a file.
Twin twin_named(const std::string& name);

// Returns the draws of laboratory k, as `key = value` lines. Each key has random numbers of its
// own, so that a changed range moves no other draw.
std::string draws_of(const Twin& twin, std::int64_t laboratory);
// Returns `nominal` with these draws.
Conditions conditions_of(const Twin& twin, std::int64_t laboratory, const Conditions& nominal);

}  // namespace echofuse::sim
