// SPDX-License-Identifier: MIT
// A model states of its own answers how far off a body may be, how sure each pixel is, and whether
// the record is one that it can know anything about. This is learnt after the training
// (fit_uncertainty.hpp) and is part of a prediction (predict.hpp). It serves any kind of model.
#pragma once
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "recon/numbers/matrix.hpp"
#include "recon/trust/out_of_distribution.hpp"
#include "recon/trust/pixel_error.hpp"

namespace echofuse::recon {

// A linear fit gives one number from a few: it is weighted least squares in closed form.
// Returns the weights w for which the rows of `inputs` times w come nearest to the targets; each
// row counts as `counts` says. `penalty` applies to the squares of w, for columns of unit mean
// square.
std::vector<double> linear_fit(const Matrix& inputs, std::span<const float> targets,
                               std::span<const float> counts, double penalty);

double product(std::span<const float> row, std::span<const double> weights);

// The terms are 1, every value, and every product of two values.
std::vector<float> quadratic_terms(std::span<const float> values);

// True if a model with these inputs finds the side of a body by the difference of both ranges
// alone.
bool side_by_ranges(const Dataset& data, Inputs inputs);

// Predictors of a map's error that are known when it is made. Row i, of map i and record rows[i]:
// |x/z| of the map's foreground (NaN if there is none); of the SPD log(1 + clicks above the
// background, in deviations of all clicks); of the radar log(peak over the scatter of the weaker
// half of the profile). A filter that smooths the radar's noise is taken into account.
Matrix predictors_of(const Matrix& maps, const Scene& scene, const Dataset& data, const Rows& rows,
                     Inputs inputs);

// The usual lateral error grows with |x/z| and with noise. A regression gives its logarithm from
// these predictors. A factor then widens it so that it holds 90 % of the validation records, each
// against a regression without it (cross-conformal prediction; Vovk, Ann. Math. Artif. Intell. 74,
// 9, 2015).
class LateralError {
 public:
  static constexpr double share_within = 0.9;

  // Row i of both belongs together; an error that is NaN is left out. The first `plain` rows are
  // records as they were measured, which set the factor. The rows behind them are copies of all of
  // these, in the same order. It learns nothing from fewer than least_records known errors.
  static constexpr std::size_t least_records = 30;
  void fit(const Matrix& predictors, const std::vector<double>& error_m, std::size_t plain);
  // Learns the factor of records whose radar was brought from a response so many times as wide,
  // from imitations of validation records. Narrowest first; the factor is interpolated.
  void add_brought(double times_wider, const Matrix& predictors,
                   const std::vector<double>& error_m);
  // Returns metres; NaN if nothing was learnt.
  double operator()(std::span<const float> predictors, double times_wider = 1) const;

  void archive(Archive archive, std::size_t predictors);

 private:
  std::vector<float> terms_of(std::span<const float> predictors) const;
  double factor_for(double times_wider) const;

  std::vector<float> least_, most_;  // ranges of the predictors
  std::vector<double> weights_;
  double factor_ = 0;
  std::vector<double> brought_times_wider_, brought_factor_;
};

// Statements about one reconstruction.
struct PredictionUncertainty {
  // The body is at most this far (metres) from where it is shown in 90 % of the records like the
  // training ones. It contains the error that the run states of its calibration: an error s of the
  // difference of both ranges moves a body at range r sideways by s r / b (baseline b). It is NaN
  // if the record is unlike the training ones, or shows nobody.
  double lateral_interval_90_m = std::numeric_limits<double>::quiet_NaN();
  OutOfDistributionScore out_of_distribution = {};
  bool stated = false;  // false if the estimator that answered states no uncertainty
};

struct UncertaintyModel {
  OutOfDistributionDetector detector;
  LateralError lateral;
  PixelError pixels;

  // Step 6 of the method (method/method.hpp) says how far off each map may be, and whether the
  // record is one that the model can know anything about. Row i of views and maps belongs to
  // rows[i].
  std::vector<PredictionUncertainty> trust(const Matrix& views, const Matrix& maps,
                                           const Scene& scene, const Dataset& data,
                                           const Rows& rows, Inputs inputs) const;
  void archive(Archive archive, const Features& of_model, const Alignment& alignment);
};

}  // namespace echofuse::recon
