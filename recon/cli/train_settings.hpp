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
  // Values as entered.
  std::string candidates;
  std::int64_t gap = 0;
  double radar_bin_m = 0;
  bool test_share_given = false;
};

// Options that define the training records: --inputs, --seed, --split, --set.
void add_split_options(CLI::App& app, TrainOptions& options, std::vector<std::string>& assignments);
void bind(Settings& settings, TrainSettings& s);
// Lists every key with meaning, range and default, as TOML.
std::string train_settings_help();
// Accepts KEY=VALUE, or the name of a TOML file. Throws Error(config) with every fault, or
// Error(usage) with the invalid item of a list.
void take(const std::vector<std::string>& assignments, TrainSettings& s);

}  // namespace echofuse::recon
