// SPDX-License-Identifier: MIT
// Uncertainty of each pixel. A pixel shows the body at depth z with probability p, otherwise the
// background B. The model's mask gives p, after it is blurred by the uncertainty of the body's
// position. If the model has no mask, p follows from its mean map m: p = (m - B) / (z - B). A
// calibration curve then corrects p to the fraction of such pixels that show the body in the
// validation records.
#pragma once
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "recon/metrics/scene_model.hpp"

namespace echofuse::recon {

// Returns the soft maps that PixelError needs. Each soft map of the model is blurred horizontally
// by the (normal) uncertainty of the body's position, unless the uncertainty is NaN. If the model
// has no soft maps (`own` has no rows), computes probabilities from its mean maps, which are
// already blurred.
SoftMaps soft_of(SoftMaps own, const Matrix& maps, const SceneModel& scene,
                 const std::vector<double>& lateral_interval_90_m);

class PixelError {
 public:
  // Learns the calibration curve and the spread of the body's depths. `truth`: ground-truth maps,
  // one per row.
  void fit(const SoftMaps& soft, const Matrix& truth, const SceneModel& scene);
  // Returns two tables in metres: the mean p z + (1 - p) B, and the standard deviation sqrt(p (1 -
  // p) (z - B)^2 + p s^2). p is the calibrated probability of the body, z its depth, B the
  // background, and s the spread of the body's depths.
  std::pair<Matrix, Matrix> operator()(const SoftMaps& soft, const SceneModel& scene) const;

  void archive(Archive archive);

 private:
  std::array<double, 11> curve_{};  // calibrated probabilities for the inputs 0, 0.1, ..., 1
  double depth_deviation_m_ = 0;
};

}  // namespace echofuse::recon
