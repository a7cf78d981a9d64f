// SPDX-License-Identifier: MIT
// A training makes a model from runs.
#pragma once
#include <string>
#include <vector>

#include "recon/use/trained_model.hpp"

namespace echofuse::recon {

struct TrainOptions {
  // This is a candidate (models/model.hpp), or "auto": the cheapest candidate within one standard
  // error of the best, by cross-validation on the training records.
  std::string model = "mlp", inputs = "fused", scaling = "record";
  std::vector<std::string> candidates;  // tried by auto; if empty, those that make sense
  SplitOptions split;
  FitOptions fit;
  MethodConfig config;
  // It says how often the records of each run count in the fit; if it is empty, each counts once.
  // The fractional part is a probability.
  std::vector<double> weights;
  // These runs stand for the use, counted from 0: validation records and the statement of the
  // model's errors are theirs. If it is empty, all runs are.
  std::vector<std::size_t> validate_on;
  // These say what is kept beside the model. `fallback` adds a model for the SPD alone
  // (TrainedModel) to a fused one that uses its inputs; `uncertainty` adds the uncertainty to any
  // model.
  bool fallback = false, uncertainty = true;
};

// Returns the records with these inputs and depth. Throws Error(failed) that names the first one of
// a dead sensor (Dataset::fault_of).
Rows rows_to_train(const Dataset& data, Inputs inputs);

// Splits the usable records, fits, and returns the model with the records it has seen. Throws
// Error(failed) if there are too few records.
TrainedModel train(const Dataset& data, const TrainOptions& options);

}  // namespace echofuse::recon
