// SPDX-License-Identifier: MIT
#include "recon/cli/train_settings.hpp"

#include <CLI/CLI.hpp>

#include "recon/numbers/text.hpp"
#include "recon/train/crossvalidate.hpp"

namespace echofuse::recon {

void add_split_options(CLI::App& app, TrainOptions& options,
                       std::vector<std::string>& assignments) {
  app.add_option("--inputs", options.inputs,
                 "fused, spd, radar, or fused-profile: without the radar's antennas")
      ->check(CLI::IsMember(inputs_names))
      ->capture_default_str();
  app.add_option("--seed", options.fit.seed, "of weights, order and random split")
      ->capture_default_str();
  app.add_option("--split", options.split.kind, "random, or blocked for sequences")
      ->check(CLI::IsMember({"random", "blocked"}))
      ->capture_default_str();
  app.add_option("--set", assignments,
                 "KEY=VALUE, or a TOML file of such settings; `train --settings` lists all")
      ->allow_extra_args(false);
}

void bind(Settings& settings, TrainSettings& s) {
  TrainOptions& o = s.options;
  settings.add("test_share", o.split.test_share, 0, 0.95, "of the records, held out for evaluate");
  settings.add("validation_share", o.split.validation_share, 0, 0.95,
               "of the rest, to stop early and to choose");
  settings.add("gap", s.gap, 0, 1'000'000, "split blocked: records dropped between two parts");
  settings.add("radar_bin_m", s.radar_bin_m, 0, 3.5,
               "m, bins from 0 to 7 m that the radar's power is added up in, without its antennas "
               "(the paper: 0.5); 0: as it is");
  settings.add("fallback", o.fallback,
               "beside a model of both sensors train those for records without antennas or radar");
  settings.add("any_response", o.any_response,
               "the runs that state no response of the radar have various ones, as a twin's have: "
               "much narrower runs are taken as they are");
  settings.add(
      "doubtful", o.doubtful,
      "records with a sensor that the run says is weak, saturated or stands still, or with a "
      "doubtful camera: leave them out, or take them",
      {"leave", "take"});
  settings.add("lossy", o.lossy,
               "records for which fewer frames or pulses arrived than signal.lossy_share",
               {"take", "leave"});
  settings.add("candidates", s.candidates,
               "of the model auto, as mean,ridge; \"\": the usual ones");
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
