// SPDX-License-Identifier: MIT
// How sure each pixel is. A pixel shows the body, at its depth z, with probability p, or else the
// background B. p comes from the model's mask, blurred by what the body's place is uncertain by;
// where a model has no mask, from how far its mean map m has come from B to z, p = (m - B)/(z - B).
// Either is then set right by a curve: how often such pixels of the validation records were body.
#pragma once
#include <array>
#include <string>
#include <vector>

#include "recon/maps/scene.hpp"
#include "recon/maps/soft_maps.hpp"

namespace echofuse::recon {

struct PixelMaps {
  Matrix mean;       // p z + (1 - p) B, metres
  Matrix deviation;  // sqrt(p (1 - p) (z - B)^2 + p s^2), metres; s: of depths within the body
};

// A model's own soft maps, each blurred sideways by what its body's place is uncertain by, as a
// normal distribution's; not where that is NaN. Of a model that has none (no rows) its mean maps,
// which are blurred already, as probabilities.
SoftMaps soft_of(SoftMaps own, const Matrix& maps, const Scene& scene,
                 const std::vector<double>& lateral_interval_90_m);

class PixelError {
 public:
  // True maps, row by row.
  void fit(const SoftMaps& soft, const Matrix& truth, const Scene& scene);
  PixelMaps operator()(const SoftMaps& soft, const Scene& scene) const;

  void archive(Archive archive);

 private:
  std::array<double, 11> curve_{};  // at shares of 0, 0.1 .. 1
  double depth_deviation_m_ = 0;
};

}  // namespace echofuse::recon
