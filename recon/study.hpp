// SPDX-License-Identifier: MIT
// What the studies have in common: models by name, trained on one run and judged on another.
#pragma once
#include <cstdint>
#include <string>

#include "recon/evaluate.hpp"

namespace echofuse::recon {

struct StudyModel {
  // "RUNG" or "RUNG:INPUTS", as in "mlp-512-256:spd". Throws Error(usage) for what is no model, or
  // one that does not take these inputs.
  explicit StudyModel(const std::string& text);
  std::string name, rung, inputs = "fused";
};

// On all usable records but the validation share: there is another run to judge by. With a
// fallback for a lost radar if asked.
TrainedModel train_whole(const Dataset& data, const StudyModel& model, std::uint64_t seed,
                         bool fallback = false);

// Means over the maps.
MapScores mean_scores(const TrainedModel& model, const Dataset& data, const Rows& rows);

}  // namespace echofuse::recon
