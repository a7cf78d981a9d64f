// SPDX-License-Identifier: MIT
#include "recon/cli/train_settings.hpp"

#include "drivers/util/command_line.hpp"
#include "recon/numbers/text.hpp"
#include "recon/train/crossvalidate.hpp"

namespace echofuse::recon {

void add_split_options(CLI::App& app, TrainOptions& options,
                       std::vector<std::string>& assignments) {
  app.add_option("--inputs", options.inputs,
                 "inputs of the model: both sensors (fused), one sensor (spd or radar), or SPD "
                 "histogram and radar range profile without antenna samples (fused-profile)")
      ->check(CLI::IsMember(inputs_names))
      ->capture_default_str();
  app.add_option("--seed", options.fit.seed,
                 "random seed for the initial weights, the training order and the random split")
      ->check(CLI::Range(0.0, max_seed))
      ->capture_default_str();
  app.add_option("--split", options.split.kind,
                 "how the records are split into training, validation and test parts: random, or "
                 "blocked (each part is contiguous; for recorded sequences)")
      ->check(CLI::IsMember({"random", "blocked"}))
      ->capture_default_str();
  app.add_option("--set", assignments,
                 "override a setting with KEY=VALUE, or several settings with a TOML file; `train "
                 "--settings` lists all settings")
      ->allow_extra_args(false);
}

void bind(Settings& settings, TrainSettings& s) {
  TrainOptions& o = s.options;
  settings.add("test_share", o.split.test_share, 0, 0.95,
               "fraction of the records that are held out for evaluation");
  settings.add("validation_share", o.split.validation_share, 0, 0.95,
               "fraction of the records outside the test part that are used for early stopping and "
               "model selection");
  settings.add("gap", s.gap, 0, 1'000'000,
               "number of records that are excluded between neighbouring parts of a blocked split");
  settings.add("radar_bin_m", s.radar_bin_m, 0, 3.5,
               "bin width, m, to which the radar power from 0 to 7 m is summed (paper: 0.5); "
               "antenna samples are then ignored; 0: keep the recorded bins");
  settings.add(
      "fallback", o.fallback,
      "also train fallback models for records without antenna samples or without radar data");
  settings.add("any_response", o.any_response,
               "accept training runs (e.g. of digital twins) with unknown radar responses that may "
               "differ; a run with a much narrower response is then not converted");
  settings.add("doubtful", o.doubtful,
               "whether records with a weak, saturated or frozen sensor or a doubtful camera are "
               "used (take) or excluded (leave)",
               {"leave", "take"});
  settings.add("lossy", o.lossy,
               "whether records that lost more frames or pulses than signal.lossy_share allows are "
               "used (take) or excluded (leave)",
               {"take", "leave"});
  settings.add("mirrored", o.mirrored,
               "whether runs are used (take) or refused if their depth maps are mirrored according "
               "to the ranges of the radar",
               {"refuse", "take"});
  settings.add("candidates", s.candidates,
               "comma-separated models that `--model auto` compares, e.g. mean,ridge; \"\": the "
               "default list");
}

std::string train_settings_help() {
  TrainOptions options;
  options.fallback = true;
  TrainSettings s(options);
  Settings settings;
  bind(settings, s);
  return settings.resolved(true);
}

void take(const std::vector<std::string>& assignments, TrainSettings& s) {
  Settings settings;
  bind(settings, s);
  for (const std::string& text : assignments)
    text.find('=') == std::string::npos ? settings.read_file(text) : settings.set(text);
  s.test_share_given = settings.given("test_share");
  TrainOptions& o = s.options;
  o.split.gap = static_cast<int>(s.gap);
  o.candidates = split_at_commas(s.candidates);
  for (const std::string& name : o.candidates) candidate_of(name, {});
}

}  // namespace echofuse::recon
