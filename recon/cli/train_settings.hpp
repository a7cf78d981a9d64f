// SPDX-License-Identifier: MIT
// `train --set` takes these settings.
#pragma once
#include <string>
#include <vector>

#include "drivers/program/settings.hpp"
#include "recon/train/train.hpp"

namespace CLI {
class App;
}

namespace echofuse::recon {

struct TrainSettings {
  explicit TrainSettings(TrainOptions& to) : options(to) {}
  TrainOptions& options;
  // Settings as typed.
  std::string candidates;
  std::int64_t gap = 0;
  double radar_bin_m = 0;
  bool test_share_given = false;
};

// Options that say which records train: --inputs, --seed, --split, --set.
void add_split_options(CLI::App& app, TrainOptions& options, std::vector<std::string>& assignments);
void bind(Settings& settings, TrainSettings& s);
// Lists every key with meaning, range and default, as TOML.
std::string train_settings_help();
// Takes KEY=VALUE, or the name of a TOML file. Throws Error(config) that lists every fault, and
// Error(usage) that names a list's bad part.
void take(const std::vector<std::string>& assignments, TrainSettings& s);

}  // namespace echofuse::recon
