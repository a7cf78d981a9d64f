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

}  // namespace echofuse::recon
