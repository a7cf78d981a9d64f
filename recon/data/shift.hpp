// SPDX-License-Identifier: MIT
// Sampled values moved along their axis by parts of a step.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

namespace echofuse::recon {

// Lanczos interpolation over eight values, its weights adding up to 1: what is as narrow as the
// steps allow keeps its width (a linear one blurs it, and costs as much as the offset it removes).
class Shift {
 public:
  // By this many steps towards the start of the axis.
  explicit Shift(double steps = 0);
  // Beyond both ends there is nothing: 0. The same value throughout, a dead sensor's, stays, or the
  // zeros at the ends would make it look alive (Dataset::fault_of).
  std::vector<float> apply(const std::vector<float>& values) const;

 private:
  std::ptrdiff_t whole_ = 0;
  std::array<float, 8> weights_{};
};

}  // namespace echofuse::recon
