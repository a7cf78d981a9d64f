// SPDX-License-Identifier: MIT
// How well each kind of model does on records that it has not seen, by blocked cross-validation: in
// a sequence no record is judged by a model that has seen its neighbours in time.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "recon/estimator/evaluate.hpp"

namespace echofuse::recon {

// What one model scored on one fold that it had not seen.
struct FoldScores {
  std::vector<MapScores> maps;
  Cost cost;
};

// Of folds that several processes measure, or that were measured before: by the numbers of the fold
// and of the model.
struct SharedFolds {
  std::function<bool(std::size_t fold, std::size_t model)> mine;  // else it is left out
  std::function<const FoldScores*(std::size_t fold, std::size_t model)> known;  // nullptr: not yet
  std::function<void(std::size_t fold, std::size_t model, const FoldScores&)> keep;
};

struct CrossvalidateOptions {
  std::string inputs = "fused", scaling = "record";
  std::vector<std::string> models = {"mean", "nearest", "ridge",
                                     "mlp"};  // candidates (models/model.hpp)
  std::size_t folds = 6;
  std::size_t gap = 10;  // records between a fold and its training records
  // Whether neighbouring rows resemble each other. Then the standard errors are those of the
  // folds; of rows in random order they are those of the maps.
  bool sequence = true;
  FitOptions fit;
  bool letters = false;  // read them off the maps as well, for their metrics
  const SharedFolds* shared = nullptr;
};

struct CrossvalidatedRow : ScoredRow {
  Cost cost;
  double train_s = 0;  // of one fold that this process measured; NaN: of none
  std::string fault;   // why it cannot be fitted here; its metrics are NaN then
};

// Means over all maps, with the standard error of their folds: of neighbours in a sequence, which
// resemble each other, each would count as a new one. Folds of unequal size (or with maps that do
// not define a metric) count by their maps: se^2 = K / (K - 1) sum_k (sum over k - n_k mean)^2 /
// n^2.
using Folds = std::vector<std::vector<MapScores>>;  // by fold, its maps
Summaries summarise_folds(const Folds& folds);
// That of a sequence; else of single maps.
Summaries summarise(const Folds& folds, bool sequence);

// One row a model; `rows` in the order that the folds are cut from. `published`, if it has records,
// holds another's reconstructions of the same records as its depth maps: they make a last row
// "published".
std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const CrossvalidateOptions& options,
                                             const Dataset& published = {});

// The candidates that make sense with these inputs, sizes included: what `train --model auto`
// tries.
std::vector<std::string> candidates(Inputs inputs);

// What is trained where nobody names a model: what "auto" chooses from some thousand records.
std::string usual_model(Inputs inputs);

// The cheapest model (multiply-adds) whose IoU is within one standard error of the best one's
// (Breiman et al., Classification and Regression Trees, 1984, 3.4.3). Throws Error(failed) if none
// has an IoU.
std::size_t cheapest_within_one_se(const std::vector<CrossvalidatedRow>& rows);

// Whether every model could be fitted; says on stderr which could not, and why.
bool all_fitted(const std::vector<CrossvalidatedRow>& rows);

// One line a model: accuracy, cost, and which is chosen.
std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen);

}  // namespace echofuse::recon
