// SPDX-License-Identifier: MIT
// `train --model auto`: k-fold cross-validation among the training records scores each candidate.
// In a sequence the folds are blocks, so that no record is judged by a model that has seen its
// neighbours in time.
#pragma once
#include <string>
#include <vector>

#include "recon/estimator/evaluate.hpp"
#include "recon/estimator/train.hpp"

namespace echofuse::recon {

struct CrossvalidatedRow : ScoredRow {
  Cost cost;
  double train_s = 0;  // mean of the folds
  std::string fault;   // why it cannot be fitted here; its metrics are NaN then
};

// Means over all maps. In a sequence neighbours resemble each other, so the standard error is that
// of the folds: se^2 = K / (K - 1) sum_k (sum over k - n_k mean)^2 / n^2; else of single maps.
using Folds = std::vector<std::vector<MapScores>>;  // by fold, its maps
Summaries summarise(const Folds& folds, bool sequence);

// One row for each of options.candidates; `rows` in the order that the folds are cut from.
std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const TrainOptions& options);

// The candidates that make sense with these inputs, sizes included.
std::vector<std::string> candidates(Inputs inputs);
// What is trained where nobody names a model: what "auto" chooses from some thousand records.
std::string usual_model(Inputs inputs);

// The cheapest model (multiply-adds) whose IoU is within one standard error of the best one's
// (Breiman et al., Classification and Regression Trees, 1984, 3.4.3). Throws Error(failed) if none
// has an IoU.
std::size_t cheapest_within_one_se(const std::vector<CrossvalidatedRow>& rows);

// One line a model: accuracy, cost, and which is chosen.
std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen);

}  // namespace echofuse::recon
