// SPDX-License-Identifier: MIT
#include "recon/cli/options.hpp"

#include <CLI/CLI.hpp>

#include "recon/data/features.hpp"

namespace echofuse::recon {

void add_inputs_option(CLI::App& app, std::string& inputs) {
  app.add_option("--inputs", inputs,
                 "fused, spd, radar, or fused-profile: without the radar's antennas")
      ->check(CLI::IsMember(inputs_names))
      ->capture_default_str();
}

std::shared_ptr<std::string> add_part_option(CLI::App& app) {
  auto out = std::make_shared<std::string>();
  app.add_option("--part", *out, part_help);
  return out;
}

std::optional<JobPart> part_of(const std::string& text) {
  return text.empty() ? std::nullopt : std::optional(JobPart::of(text));
}

std::string is_candidate(const std::string& text) {
  try {
    candidate_of(text, {});
    return {};
  } catch (const Error& error) {
    return error.what();
  }
}

void add_fit_options(CLI::App& app, std::string& scaling, FitOptions& fit) {
  app.add_option("--scaling", scaling, "per-record scaling of each sensor")
      ->check(CLI::IsMember(scaling_names))
      ->capture_default_str();
  app.add_option("--hidden", fit.hidden, "mlp: widths of the hidden layers (512,256)")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(1, 65536));
  app.add_option("--basis", fit.basis,
                 "factorised: body shapes (32); pca: components of "
                 "the map (128); nearest: neighbours (1)")
      ->check(CLI::Range(1, 1024));
  app.add_option("--epochs", fit.epochs, "default: 60 (mlp), 100 (factorised)")
      ->check(CLI::Range(1, 100000));
  app.add_option(
         "--batch", fit.batch,
         "default: 64; mlp and pca-mlp: 128 from 3000 training records on (factorised: four "
         "times as many as said from 10,000 bodies on)")
      ->check(CLI::Range(1, 65536));
  app.add_option("--learning-rate", fit.learning_rate,
                 "at the beginning; default: 0.002 (mlp; times the root of batch / 64 above that), "
                 "0.003 (factorised)")
      ->check(CLI::Range(1e-9, 10.0));
  app.add_option("--weight-decay", fit.weight_decay, "default: 0.7 (mlp), 0.3 (factorised)")
      ->check(CLI::Range(0.0, 10.0));
}

}  // namespace echofuse::recon
