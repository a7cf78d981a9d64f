// SPDX-License-Identifier: MIT
// Loss of a map with two outputs per pixel: the log-odds of foreground, and its depth.
//   mask   cross-entropy
//   depth  s log cosh(e / s), in units of the depths' spread, on the true foreground only; s is an
//          eighth of the spread, so that outliers count linearly, not quadratically
#pragma once
#include <cmath>
#include <span>
#include <vector>

#include "recon/metrics/scene_model.hpp"

namespace echofuse::recon {

// Outputs: log-odds of every pixel, then depths of every pixel, m. Replaces them by the slopes of
// the loss and returns it. T is float (training) or double (checking the slopes).
template <class T>
double mask_loss(std::span<const float> truth, std::span<const float> background, T depth_spread_m,
                 std::span<T> outputs) {
  const std::size_t pixels = truth.size();
  const T soft = depth_spread_m / 8;
  T sum = 0;
  for (std::size_t p = 0; p < pixels; ++p) {
    const bool body = true_foreground(truth[p], background[p]);
    T &odds = outputs[p], &depth = outputs[pixels + p];
    const T small = std::exp(-std::abs(odds));  // does not overflow
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
