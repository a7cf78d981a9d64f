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
  double train_s = 0;  // training time averaged over the folds, s
  std::string fault;   // why the model cannot be fitted (its metrics are then NaN); otherwise empty
};

// summarise() returns the mean of each metric over all maps, and its standard error. In a sequence,
// neighbouring records are correlated, so the standard error is computed between folds: se^2 = K /
// (K - 1) sum_k (S_k - n_k m)^2 / n^2. K is the number of folds, n the number of maps, and m the
// mean; fold k has n_k maps with sum S_k. If the records are not a sequence, the maps are treated
// as independent.
using Folds = std::vector<std::vector<MapScores>>;
Summaries summarise(const Folds& folds, bool sequence);

// Returns one row for each candidate. Each fold is a contiguous part of `rows`.
std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const TrainOptions& options);

// Returns the names of the candidates, including their sizes, for inputs that can or cannot
// distinguish left and right (Layout::shows_sides).
std::vector<std::string> candidates(bool shows_sides);
// Returns the default model, which "auto" chooses if there are a few thousand records.
std::string usual_model(bool shows_sides);

// Returns the index of the cheapest model (fewest multiply-adds) with an IoU within one standard
// error of the best. Source: Breiman et al., Classification and Regression Trees, 1984, 3.4.3. Uses
// RMSE if the IoU is undefined because no map has a foreground. Throws Error(failed) if no model
// has either metric.
std::size_t cheapest_within_one_se(const std::vector<CrossvalidatedRow>& rows);

// Returns a table with one line per model, which contains its accuracy and cost. The chosen model
// is marked.
std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen);

}  // namespace echofuse::recon
