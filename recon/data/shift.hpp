// SPDX-License-Identifier: MIT
// Shifts sampled values along their axis by fractions of a step.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

namespace echofuse::recon {

// Lanczos interpolation over eight values with weights that add up to 1. It keeps the width of the
// narrowest possible peak; linear interpolation would blur it by as much as the offset.
class Shift {
 public:
  // Shifts the values by this many steps towards the start of the axis.
  explicit Shift(double steps = 0);
  // Values beyond both ends are 0. A constant row, from a dead sensor, is not changed; otherwise
  // zeros at its ends would hide the fault (Dataset::fault_of).
  std::vector<float> apply(const std::vector<float>& values) const;

 private:
  std::ptrdiff_t whole_ = 0;
  std::array<float, 8> weights_{};
};

}  // namespace echofuse::recon
