// SPDX-License-Identifier: MIT
// Uncertainty that a model states for its predictions: position error of the body, error of each
// pixel, and whether the record is in distribution. Learnt after the training (fit_uncertainty.hpp)
// and part of a prediction (predict.hpp). Works with any model.
#pragma once
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "recon/numbers/matrix.hpp"
#include "recon/trust/out_of_distribution.hpp"
#include "recon/trust/pixel_error.hpp"

namespace echofuse::recon {

// Weighted least squares in closed form: returns the w that minimises |inputs w - targets|^2 with
// row weights `counts`. `penalty` applies to the squares of w, for columns of unit mean square.
std::vector<double> linear_fit(const Matrix& inputs, std::span<const float> targets,
                               std::span<const float> counts, double penalty);

double product(std::span<const float> row, std::span<const double> weights);

// The terms are 1, each value, and each product of two values.
std::vector<float> quadratic_terms(std::span<const float> values);

// True if a model with these inputs derives the side of a body from the difference of both ranges
// alone.
bool side_by_ranges(const Dataset& data, Inputs inputs);

// Predictors of a map's error that are known when it is made. Row i, for map i and record rows[i]:
// |x/z| of the map's foreground (NaN without one); of the SPD log(1 + clicks above the
// background, in standard deviations of all clicks); of the radar log(peak over the standard
// deviation of the weaker half of the profile), corrected for a filter that smooths the noise.
Matrix predictors_of(const Matrix& maps, const SceneModel& scene, const Dataset& data,
                     const Rows& rows, Inputs inputs);

// Interval of the lateral error, which grows with |x/z| and with noise. A regression on the
// predictors gives the logarithm of the typical error. A factor widens it to contain 90 % of the
// validation records, each tested on a regression without it (cross-conformal prediction; Vovk,
// Ann. Math. Artif. Intell. 74, 9, 2015).
class LateralError {
 public:
  static constexpr double share_within = 0.9;

  // Row i of both belongs together; a NaN error is skipped. The first `plain` rows are unmodified
  // records, which set the factor. The others are copies of them, in the same order. Learns nothing
  // from fewer than least_records known errors.
  static constexpr std::size_t least_records = 30;
  void fit(const Matrix& predictors, const std::vector<double>& error_m, std::size_t plain);
  // Learns the factor for records with a radar converted from a response this many times wider,
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

// Uncertainty of one reconstruction.
struct PredictionUncertainty {
  // Radius around the shown position that contains the body in 90 % of the records like the
  // training, in m. Includes the calibration error stated by the run: an error s of the difference
  // of both ranges moves a body at range r sideways by s r / b (baseline b). NaN if the record is
  // out of distribution or shows no body.
  double lateral_interval_90_m = std::numeric_limits<double>::quiet_NaN();
  OutOfDistributionScore out_of_distribution = {};
  bool stated = false;  // false if the estimator used has no uncertainty
};

struct UncertaintyModel {
  OutOfDistributionDetector detector;
  LateralError lateral;
  PixelError pixels;

  // Step 6 of the method (method/method.hpp): returns the error to expect of each map, and whether
  // its record is in distribution. Row i of views and maps belongs to rows[i].
  std::vector<PredictionUncertainty> trust(const Matrix& views, const Matrix& maps,
                                           const SceneModel& scene, const Dataset& data,
                                           const Rows& rows, Inputs inputs) const;
  void archive(Archive archive, const Features& of_model, const Alignment& alignment);
};

}  // namespace echofuse::recon
