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
  Choice(const SceneModel& judged_by, const Split& split, const SplitOptions& options);

  using Fit = std::function<Estimator(const Rows& rows)>;
  // Adds a candidate: fits one model per fold and scores it on the held-out records. Throws
  // Error(interrupted) after an interrupt.
  void add(const std::string& name, const Dataset& data, Fit fit);
  // Chooses the candidate with the largest gain over the first one, if this gain exceeds `errors`
  // standard errors; otherwise chooses the first.
  void choose(double errors);

  std::size_t chosen() const { return chosen_; }  // index in the order of add()
  bool is(const std::string& name) const { return entries_[chosen_].row.name == name; }
  // Returns the gain of the chosen candidate over the chosen candidate of `other`, on the same
  // records. Returns 0 if the gain is below `errors` standard errors.
  double gain_over(const Choice& other, double errors) const {
    return gain_of(entries_[chosen_], other.entries_[other.chosen_], errors);
  }
  // Returns the mean gain in score over the chosen candidate of `other`, and the standard error of
  // this gain.
  std::pair<double, double> gain_and_error(const Choice& other) const {
    return gain_and_error_of(entries_[chosen_], other.entries_[other.chosen_]);
  }
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
  static std::pair<double, double> gain_and_error_of(const Alternative& entry,
                                                     const Alternative& than);
  static double gain_of(const Alternative& entry, const Alternative& than, double errors);

  const SceneModel& judged_by_;
  const Split& split_;
  bool sequence_;
  std::vector<Split> folds_;
  std::vector<Alternative> entries_;
  std::size_t chosen_ = 0;
};

}  // namespace echofuse::recon
