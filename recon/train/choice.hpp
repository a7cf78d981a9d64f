// SPDX-License-Identifier: MIT
// Cross-validation of `train --from`: compares the candidates that can be made from an old model,
// and chooses one.
#pragma once
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "recon/train/crossvalidate.hpp"
#include "recon/train/fit_uncertainty.hpp"

namespace echofuse::recon {

// Candidates that are compared by cross-validation. The scene `judged_by` defines the foreground
// for the scores. All datasets must contain the same records. Keeps references to the arguments of
// the constructor.
class Choice {
 public:
  Choice(const SceneModel& assessed_by, const Split& split, const SplitOptions& options);

  using Fit = std::function<Estimator(const Rows& rows)>;
  // Adds a candidate: fits one model per fold and scores it on the held-out records. Throws
  // Error(interrupted) after an interrupt.
  void add(const std::string& name, const Dataset& data, Fit fit);
  // Chooses, of the candidates better than the first one by more than `errors` standard errors, the
  // one with the best score; without such a candidate, chooses the first.
  void choose(double errors);

  std::size_t size() const { return entries_.size(); }
  std::size_t chosen() const { return chosen_; }  // index in the order of add()
  bool is(const std::string& name) const { return entries_[chosen_].row.name == name; }
  // Returns the smallest mean gain in score of the chosen candidate over candidates [first, last),
  // and the standard error of this gain.
  std::pair<double, double> gain_over(std::size_t first, std::size_t last) const;
  Estimator fit() const { return entries_[chosen_].fit(split_.train); }
  std::vector<CrossvalidatedRow> table() const;
  // Returns, for each fold, the model of the chosen candidate and the rows held out from its
  // training.
  std::vector<HeldOut> held_out() const;

 private:
  struct Alternative {
    CrossvalidatedRow row;
    Fit fit;
    std::vector<Estimator> models = {};
    std::vector<double> score = {};  // IoU minus weighted lateral error of each record
  };
  static std::pair<double, double> gain_and_error(const Alternative& entry,
                                                  const Alternative& than);

  const SceneModel& assessed_by_;
  const Split& split_;
  bool sequence_;
  std::vector<Split> folds_;
  std::vector<Alternative> entries_;
  std::size_t chosen_ = 0;
};

}  // namespace echofuse::recon
