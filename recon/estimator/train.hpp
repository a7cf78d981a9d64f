// SPDX-License-Identifier: MIT
// From runs to a model file.
#pragma once
#include <string>
#include <vector>

#include "recon/estimator/trained_model.hpp"

namespace echofuse::recon {

struct TrainOptions {
  // A candidate (models/model.hpp), or "auto": the cheapest candidate within one standard error of
  // the best, by cross-validation on the training records.
  std::string model = "mlp", inputs = "fused", scaling = "record";
  std::vector<std::string> candidates;  // auto: what to try; empty: what makes sense
  SplitOptions split;
  FitOptions fit;
  MethodConfig config;
  // How often the records of each run count in the fit; empty: once. A part of 1 is the chance.
  std::vector<double> weights;
  // Runs that stand for the use, counted from 0: validation records and what is stated of the
  // model's errors are theirs. Empty: all.
  std::vector<std::size_t> validate_on;
  // What is kept beside the model: of a fused one that looks at its inputs a model for the SPD
  // alone (TrainedModel); of any its uncertainty.
  bool fallback = false, uncertainty = true;
};

// The records with these inputs and depth. Throws Error(failed) that names the first one of a dead
// sensor (Dataset::fault_of).
Rows rows_to_train(const Dataset& data, Inputs inputs);

// Splits the usable records, fits, and returns the model with what it has seen. Throws
// Error(failed) if there are too few records.
TrainedModel train(const Dataset& data, const TrainOptions& options);

}  // namespace echofuse::recon
