// SPDX-License-Identifier: MIT
// `train --model auto`: k-fold cross-validation among the training records scores each candidate.
// In a sequence the folds are blocks. So no record is judged by a model that has seen its
// neighbours in time.
#pragma once
#include <string>
#include <vector>

#include "recon/train/train.hpp"
#include "recon/use/evaluate.hpp"

namespace echofuse::recon {

struct CrossvalidatedRow : ScoredRow {
  Cost cost;
  double train_s = 0;  // mean of the folds
  std::string fault;   // why the model cannot be fitted here; its metrics are NaN then
};

// The means are over all maps. In a sequence neighbours resemble each other, so the standard error
// is that of the folds. Formula: se^2 = K / (K - 1) sum_k (sum over k - n_k mean)^2 / n^2.
// Otherwise that of single maps.
using Folds = std::vector<std::vector<MapScores>>;  // for each fold, its maps
Summaries summarise(const Folds& folds, bool sequence);

// Returns one row for each of options.candidates. Folds are cut from `rows` in their order.
std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const TrainOptions& options);

// Returns the candidates that make sense with these inputs, sizes included.
std::vector<std::string> candidates(Inputs inputs);
// Default model: "auto" chooses it from some thousand records.
std::string usual_model(Inputs inputs);

// Returns the cheapest model (multiply-adds) whose IoU is within one standard error of the best
// one's. Source: Breiman et al., Classification and Regression Trees, 1984, 3.4.3. If none has an
// IoU, as no body stands out, RMSE takes its place. Throws Error(failed) if none has that.
std::size_t cheapest_within_one_se(const std::vector<CrossvalidatedRow>& rows);

// Text of one line a model: accuracy, cost, and which is chosen.
std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen);

}  // namespace echofuse::recon
