// SPDX-License-Identifier: MIT
// Uncertainty of a model's predictions: the position error of the body, the error of each pixel,
// and whether the record is in distribution. It is learnt after the training (fit_uncertainty.hpp)
// and is part of each prediction (predict.hpp). It works with any kind of model.
#pragma once
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "recon/numbers/matrix.hpp"
#include "recon/trust/out_of_distribution.hpp"
#include "recon/trust/pixel_error.hpp"

namespace echofuse::recon {

// Weighted linear fit in closed form: returns the w that minimises the mean of (inputs w -
// targets)^2, with row weights `counts`, plus `penalty` times |v|^2. The vector v contains the
// coefficients for columns of `inputs` that are scaled to a mean square of 1.
std::vector<double> linear_fit(const Matrix& inputs, std::span<const float> targets,
                               std::span<const float> counts, double penalty);

double product(std::span<const float> row, std::span<const double> weights);

// Returns the terms of a quadratic polynomial: 1, each value, and each product of two values.
std::vector<float> quadratic_terms(std::span<const float> values);

// Returns true if a model with these inputs can distinguish left and right only from the difference
// between the SPD range and the radar range.
bool side_by_ranges(const Dataset& data, Inputs inputs);

// Returns predictors of the error of a map, which are known without the ground-truth map. Row i
// belongs to map i and record rows[i]. The columns are: |x/z| of the map's foreground (NaN if the
// map has none); for the SPD, log(1 + clicks above the background, in standard deviations of all
// clicks); for the radar, log(peak over the standard deviation of the weaker half of the profile).
// The radar column is corrected if a filter has smoothed the noise.
Matrix predictors_of(const Matrix& maps, const SceneModel& scene, const Dataset& data,
                     const Rows& rows, Inputs inputs);

// Interval of the lateral error, which increases with |x/z| and with noise. A regression on the
// predictors gives the logarithm of the typical error. A factor widens the interval until it
// contains the errors of 90 % of the validation records. Each of these records is tested by a
// regression fitted without it (cross-conformal prediction; Vovk, Ann. Math. Artif. Intell. 74, 9,
// 2015).
class LateralError {
 public:
  static constexpr double share_within = 0.9;

  // Learns from the errors of maps; row i of `predictors` belongs to error_m[i], and an error of
  // NaN is skipped. The first `plain` rows are unmodified records; only these determine the factor
  // that widens the interval. The other rows are degraded copies of the first rows, in the same
  // order. Learns nothing if the errors of fewer than `min_records` unmodified records are known.
  static constexpr std::size_t min_records = 30;
  void fit(const Matrix& predictors, const std::vector<double>& error_m, std::size_t plain);
  // Learns the factor for a radar response that is `times_wider` times as wide as that of the
  // training data, from imitated validation records. Must be called in order of increasing width.
  // The factor is interpolated between widths.
  void add_converted(double times_wider, const Matrix& predictors,
                     const std::vector<double>& error_m);
  // Returns the 90 % quantile of the lateral error, m; NaN if nothing was learnt or the map has no
  // foreground.
  double operator()(std::span<const float> predictors, double times_wider = 1) const;

  void archive(Archive archive, std::size_t predictors);

 private:
  std::vector<float> terms_of(std::span<const float> predictors) const;

  std::vector<float> minimum_, maximum_;  // smallest and largest value of each predictor
  std::vector<double> weights_;
  // Factors of unconverted records and of each wider response.
  std::vector<double> times_wider_ = {1}, factors_;
};

struct PredictionUncertainty {
  // Half-width of the interval around the predicted lateral position that contains the body for 90
  // % of the records that resemble the training data, m. Includes the error of the run's range
  // calibration and the tolerance of the mounting. An error s of the difference between the SPD
  // range and the radar range moves a body at range r sideways by s r / b (baseline b). NaN if the
  // record is out of distribution or shows no body.
  double lateral_interval_90_m = std::numeric_limits<double>::quiet_NaN();
  OutOfDistributionScore out_of_distribution = {};
  bool stated = false;  // false: the estimator does not estimate errors
};

struct UncertaintyModel {
  OutOfDistributionDetector detector;
  LateralError lateral;
  PixelError pixels;

  // Step 6 of the method (method/method.hpp): returns the expected error of each map, and whether
  // its record is in distribution. Row i of `views` and `maps` belongs to rows[i].
  std::vector<PredictionUncertainty> trust(const Matrix& views, const Matrix& maps,
                                           const SceneModel& scene, const Dataset& data,
                                           const Rows& rows, Inputs inputs) const;
  void archive(Archive archive, const Features& of_model, const Alignment& alignment);
};

}  // namespace echofuse::recon
