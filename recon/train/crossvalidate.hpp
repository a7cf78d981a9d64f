// SPDX-License-Identifier: MIT
// `train --model auto`: scores each candidate by k-fold cross-validation on the training records.
// In a sequence the folds are blocks, so that a model is not tested on neighbours in time of its
// training records.
#pragma once
#include <string>
#include <vector>

#include "recon/score/evaluate.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {

struct CrossvalidatedRow : ScoredRow {
  Cost cost;
  double train_s = 0;  // mean over the folds
  std::string fault;   // why the model cannot be fitted; its metrics are NaN then
};

// Means over all maps. In a sequence neighbours are correlated, so the standard error is between
// folds: se^2 = K / (K - 1) sum_k (sum over k - n_k mean)^2 / n^2. Otherwise it is that of single
// maps.
using Folds = std::vector<std::vector<MapScores>>;  // maps of each fold
Summaries summarise(const Folds& folds, bool sequence);

// Returns one row for each of options.candidates. The folds keep the order of `rows`.
std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const TrainOptions& options);

// Returns the candidates that suit these inputs of a detector with this number of zones, with
// sizes.
std::vector<std::string> candidates(Inputs inputs, std::size_t zones);
// Default model: the one that "auto" chooses with a few thousand records.
std::string usual_model(Inputs inputs, std::size_t zones = 0);

// Returns the cheapest model (multiply-adds) within one standard error of the best IoU (Breiman et
// al., Classification and Regression Trees, 1984, 3.4.3). Uses RMSE if the IoU is undefined
// without a foreground. Throws Error(failed) if no model has either.
std::size_t cheapest_within_one_se(const std::vector<CrossvalidatedRow>& rows);

// Table with one line per model: accuracy, cost, and which is chosen.
std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen);

}  // namespace echofuse::recon
