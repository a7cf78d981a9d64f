// SPDX-License-Identifier: MIT
// Uncertainty of each pixel. A pixel shows the body, at its depth z, with probability p, or else
// the background B. p comes from the model's mask, blurred by the uncertainty of the body's place.
// If a model has no mask, p comes from how far its mean map m has come from B to z, p = (m - B)/(z
// - B). A curve then corrects either one: it says how often such pixels of the validation records
// were body.
#pragma once
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "recon/metrics/scene.hpp"

namespace echofuse::recon {

// Returns a model's own soft maps, each blurred sideways by the uncertainty of its body's place, as
// that of a normal distribution; a map whose uncertainty is NaN is not blurred. For a model without
// soft maps (no rows) it takes the mean maps as probabilities; these are blurred already.
SoftMaps soft_of(SoftMaps own, const Matrix& maps, const Scene& scene,
                 const std::vector<double>& lateral_interval_90_m);

class PixelError {
 public:
  // `truth` holds the true maps, one a row.
  void fit(const SoftMaps& soft, const Matrix& truth, const Scene& scene);
  // Returns two tables in metres: the mean p z + (1 - p) B, and the deviation
  // sqrt(p (1 - p) (z - B)^2 + p s^2); s is the spread of depths in the body.
  std::pair<Matrix, Matrix> operator()(const SoftMaps& soft, const Scene& scene) const;

  void archive(Archive archive);

 private:
  std::array<double, 11> curve_{};  // at shares of 0, 0.1 .. 1
  double depth_deviation_m_ = 0;
};

}  // namespace echofuse::recon
