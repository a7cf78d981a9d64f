// SPDX-License-Identifier: MIT
// A twin is a set of ranges from which the settings of virtual laboratories are sampled.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

// Range from which a setting in Conditions is sampled: uniformly in [low, high] or, if
// `logarithmic` is true, uniformly in the logarithm.
struct KeyRange {
  std::string key;
  double low = 0, high = 0;
  bool logarithmic = false;
};

struct Twin {
  std::int64_t seed = 1;
  std::vector<KeyRange> ranges;
};

// Parses TOML text with lines `key = [low, high]`, `key = [low, high, "log"]` and `seed = 1`.
// Throws Error(config) with all mistakes. A key must be a real-valued setting in Conditions that is
// not stored in the run file (as axes and baseline_m are), and may occur only once. A range must be
// inside the limits of the setting.
Twin read_twin(const std::string& text, const std::string& name);
// Returns the twin as TOML text for read_twin(), without comments.
std::string to_text(const Twin& twin);
// Returns the text of the installed file config/twin.toml, which contains the source of each range.
std::string default_twin();
// Reads a twin. `name` is `default`, TOML text (with "="), or a file name.
Twin twin_named(const std::string& name);

// Returns the settings sampled for this laboratory number, as `key = value` lines. Each key has its
// own random stream, so changing one range does not change the other values.
std::string draws_of(const Twin& twin, std::int64_t laboratory);
// Returns a copy of `nominal` that contains the values sampled for this laboratory number.
Conditions conditions_of(const Twin& twin, std::int64_t laboratory, const Conditions& nominal);

}  // namespace echofuse::sim
