// SPDX-License-Identifier: MIT
// A Shift moves sampled values along their axis by parts of a step.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

namespace echofuse::recon {

// Lanczos interpolation over eight values with weights that add up to 1. A peak as narrow as the
// steps allow keeps its width (a linear interpolation blurs it, and costs as much as the offset it
// removes).
class Shift {
 public:
  // Moves the values by this many steps towards the start of the axis.
  explicit Shift(double steps = 0);
  // Beyond both ends the values are 0. A row of one value throughout, from a dead sensor, stays as
  // it is, or the zeros at the ends would make it look alive (Dataset::fault_of).
  std::vector<float> apply(const std::vector<float>& values) const;

 private:
  std::ptrdiff_t whole_ = 0;
  std::array<float, 8> weights_{};
};

}  // namespace echofuse::recon
