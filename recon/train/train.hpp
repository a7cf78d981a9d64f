// SPDX-License-Identifier: MIT
// A training makes a model from runs.
#pragma once
#include <string>
#include <vector>

#include "recon/use/trained_model.hpp"

namespace echofuse::recon {

struct TrainOptions {
  // Candidate (models/model.hpp), or "auto": the cheapest candidate within one standard error of
  // the best, by cross-validation on the training records.
  std::string model = "mlp", inputs = "fused", scaling = "record";
  std::vector<std::string> candidates;  // tried by auto; if empty, those that make sense
  SplitOptions split;
  FitOptions fit;
  // Parts kept beside the model. `fallback`: a model for the SPD alone (TrainedModel), beside a
  // fused one; `uncertainty`: the uncertainty of any model.
  bool fallback = false, uncertainty = true;
  // True: the runs that state no response have various ones, as those of a twin.
  bool any_response = false;
  std::string doubtful = "leave";  // or take: records whose verdict is not ok (Dataset::doubt_of)
  std::string lossy = "take";      // or leave: records of which samples were lost
};

// Records that a training learns from, and a line that counts the others by reason, and the lossy
// ones among them. Reasons: a sensor missing, dead or doubtful; a copy of a record before; damaged.
// Empty if all train and none is lossy.
struct TrainingRows {
  Rows rows;
  std::string left_out;
};
// Throws Error(failed) if no record has a sensor, or all are left out. Throws it also if more than
// most_damaged of the records are dead or damaged.
TrainingRows rows_to_train(const Dataset& data, Inputs inputs);

// Applies the options' treatment of doubtful and lossy records.
void apply_doubts(Dataset& data, const TrainOptions& options);

// Returns the inputs that the model of these options takes: only some take the lags of antennas.
Inputs inputs_to_train(const TrainOptions& options);

// Returns a line if a random split would judge records by their likes, else nothing. Criterion: for
// many of a sample of rows the nearest depth map is that of a neighbour in time.
std::string alike_neighbours(const Dataset& data, const Rows& rows);

// Returns a line if held-out scenes are also in the training although they are no neighbours, else
// nothing. Criterion: around most held-out maps with a body a few training maps are much nearer
// than all others.
std::string recurring_scenes(const Dataset& data, const Split& split, const Scene& scene);

// Splits the usable records, fits, and returns the model with the records it has seen. Throws
// Error(failed) if there are too few records.
TrainedModel train(const Dataset& data, const TrainOptions& options);

}  // namespace echofuse::recon
