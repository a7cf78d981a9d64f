// SPDX-License-Identifier: MIT
// This is what the studies have in common: models by name, trained on one run and judged on
// another.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/program/job_part.hpp"
#include "recon/use/evaluate.hpp"

namespace echofuse::recon {

struct StudyOptions {
  std::string out;              // folder
  std::optional<JobPart> part;  // measure only its share, into a file of its own
  std::size_t seeds = 3;        // 1, 2, 3 ...
  int threads = 0;
  bool quiet = false;
};

std::string joined(const std::vector<std::string>& texts, const char* between);

struct StudyModel {
  // "CANDIDATE" or "CANDIDATE:INPUTS", as in "mlp-512-256:spd". Throws Error(usage) for what is no
  // model, or one that does not take these inputs.
  explicit StudyModel(const std::string& text);
  std::string name, candidate, inputs = "fused";
};
bool is_network(const StudyModel& model);

// Behind each model that takes the radar's antennas the same with the range profile alone.
std::vector<std::string> with_profiles(const std::vector<std::string>& models);

// On all usable records but the validation share: there is another run to judge by. `with_parts`: a
// fused model that looks at its inputs has a fallback for a lost radar beside it, and one that
// places a body what it needs to see two.
TrainedModel train_on_all(const Dataset& data, const StudyModel& model, std::uint64_t seed,
                          bool with_parts = false);

// A map of every record. The model answers for the rows; the others, which it cannot read, show the
// empty room.
Matrix predict_or_empty_room(const TrainedModel& model, const Records& records, const Rows& rows);

// Means over the maps, one a row.
MapScores mean_scores(const Matrix& maps, const Dataset& data, const Rows& rows,
                      const Scene& scene);

}  // namespace echofuse::recon
