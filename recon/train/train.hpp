// SPDX-License-Identifier: MIT
// Trains a model on runs.
#pragma once
#include <string>
#include <vector>

#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {

struct TrainOptions {
  // Candidate (models/model.hpp), or "auto": the cheapest candidate within one standard error of
  // the best, by cross-validation on the training records.
  std::string model = "mlp", inputs = "fused", scaling = "record";
  std::vector<std::string> candidates;  // tried by auto; if empty, the usual ones
  SplitOptions split;
  FitOptions fit;
  // Optional parts. `fallback`: a model for the SPD alone, in addition to a fused one
  // (TrainedModel); `uncertainty`: the uncertainty of each estimator.
  bool fallback = false, uncertainty = true;
  // True: runs without a stated response may have any response, as those of a digital twin.
  bool any_response = false;
  std::string doubtful = "leave";  // or take: records with a verdict other than ok (doubt_of)
  std::string lossy = "take";      // or leave: records with lost samples
};

// Records used for training, and a line that counts the others by reason (a sensor missing, dead or
// doubtful; a duplicate of an earlier record; damaged), and the lossy ones among them. The line is
// empty if all are used and none is lossy.
struct TrainingRows {
  Rows rows;
  std::string left_out;
  std::vector<std::string> reasons;  // by row (Dataset::left_out)
};
// Throws Error(failed) if no record has a required sensor, if all records are left out, or if more
// than most_damaged of them are dead or damaged.
TrainingRows rows_to_train(const Dataset& data, Inputs inputs);

// Applies the options for doubtful and lossy records.
void apply_doubts(Dataset& data, const TrainOptions& options);

// Returns the inputs of the model of these options: only some models use the antennas' lags.
Inputs inputs_to_train(const TrainOptions& options);

// Returns a warning if a random split would be optimistic, otherwise nothing. Criterion: in a
// sample of rows, the nearest depth map is often that of a neighbour in time.
std::string alike_neighbours(const Dataset& data, const Rows& rows);

// Returns a warning if scenes recur in training and test without being neighbours, otherwise
// nothing. Criterion: for most held-out maps with a body, a few training maps are much nearer than
// all others.
std::string recurring_scenes(const Dataset& data, const Split& split, const SceneModel& scene);

// Splits the usable records, fits, and returns the model with the list of its records. Throws
// Error(failed) if there are too few records.
TrainedModel train(const Dataset& data, const TrainOptions& options);

}  // namespace echofuse::recon
