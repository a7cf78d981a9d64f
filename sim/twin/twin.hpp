// SPDX-License-Identifier: MIT
// A twin is a set of ranges from which each virtual laboratory draws its conditions.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

// Range of a key of Conditions: uniform in [low, high], or uniform in the logarithm.
struct KeyRange {
  std::string key;
  double low = 0, high = 0;
  bool logarithmic = false;
};

struct Twin {
  std::int64_t seed = 1;  // changes all laboratories
  std::vector<KeyRange> ranges;
};

// Parses TOML: `key = [low, high]`, `key = [low, high, "log"]` and `seed = 1`. Throws Error(config)
// with every fault: a key that is not a real number of Conditions, that the run file states (axes,
// baseline_m) or that occurs twice, and a range that is empty or outside the key's limits.
Twin read_twin(const std::string& text, const std::string& name);
// Returns the ranges as text for read_twin, without comments.
std::string to_text(const Twin& twin);
// Returns the text of the installed ranges (config/twin.toml), with the source of each.
std::string default_twin();
// Reads a twin: `default`, TOML text (contains "="), or a file name.
Twin twin_named(const std::string& name);

// Returns the draws of laboratory k, as `key = value` lines. Each key has its own random stream, so
// changing one range leaves the other draws unchanged.
std::string draws_of(const Twin& twin, std::int64_t laboratory);
// Returns `nominal` with these draws.
Conditions conditions_of(const Twin& twin, std::int64_t laboratory, const Conditions& nominal);

}  // namespace echofuse::sim
