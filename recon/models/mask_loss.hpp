// SPDX-License-Identifier: MIT
// Loss of a map with two outputs per pixel: log-odds of foreground, and depth of the foreground.
//   mask   cross-entropy
//   depth  s log cosh(e / s) / spread for error e, on the true foreground only; s is an eighth of
//          the spread of the depths, so that large errors count linearly instead of quadratically
#pragma once
#include <cmath>
#include <span>
#include <vector>

#include "recon/metrics/scene_model.hpp"

namespace echofuse::recon {

// Computes the loss of one map. On input, `outputs` contains the log-odds of all pixels, followed
// by the depths of all pixels (m). On output, it contains the derivatives of the loss. T is float
// in training, and double in tests of the derivatives.
template <class T>
double mask_loss(std::span<const float> truth, std::span<const float> background, T depth_spread_m,
                 std::span<T> outputs) {
  const std::size_t pixels = truth.size();
  const T soft = depth_spread_m / 8;
  T sum = 0;
  for (std::size_t p = 0; p < pixels; ++p) {
    const bool body = true_foreground(truth[p], background[p]);
    T &odds = outputs[p], &depth = outputs[pixels + p];
    // Cannot overflow, because the exponent is not positive.
    const T small = std::exp(-std::abs(odds));
    sum += std::log1p(small) + std::max(odds, T{0}) - (body ? odds : T{0});
    odds = (odds > 0 ? 1 : small) / (1 + small) - T(body);
    if (!body) {
      depth = 0;
      continue;
    }
    const T error = std::abs(depth - T(truth[p])) / soft, fall = std::exp(-2 * error);
    sum += (error + std::log1p(fall) - T(M_LN2)) * soft / depth_spread_m;
    depth = std::copysign((1 - fall) / (1 + fall), depth - T(truth[p])) / depth_spread_m;
  }
  return double{sum};
}

}  // namespace echofuse::recon
