// SPDX-License-Identifier: MIT
// Settings of `train --set`.
#pragma once
#include <string>
#include <vector>

#include "drivers/util/settings.hpp"
#include "recon/train/train.hpp"

namespace CLI {
class App;
}

namespace echofuse::recon {

struct TrainSettings {
  explicit TrainSettings(TrainOptions& to) : options(to) {}
  TrainOptions& options;
  // Values as entered by the user.
  std::string candidates;
  std::int64_t gap = 0;
  double radar_bin_m = 0;
  bool test_share_given = false;
};

// Adds the options for the model inputs, the random seed, the split of the records, and other
// settings: --inputs, --seed, --split, --set.
void add_split_options(CLI::App& app, TrainOptions& options, std::vector<std::string>& assignments);
void bind(Settings& settings, TrainSettings& s);
// Returns all settings in TOML format, each with its meaning, range and default.
std::string train_settings_help();
// Applies the assignments. Each is KEY=VALUE or the path of a TOML file with settings.
// Throws Error(config) with a list of all invalid settings. Throws Error(usage) if `candidates`
// contains an invalid model name.
void take(const std::vector<std::string>& assignments, TrainSettings& s);

}  // namespace echofuse::recon
