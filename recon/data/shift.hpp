// SPDX-License-Identifier: MIT
// Shifts sampled values along their axis by fractions of a step.
#pragma once
#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace echofuse::recon {

// Lanczos interpolation over eight values with weights that add up to 1. It preserves the width of
// the narrowest possible peak, which linear interpolation would broaden.
class Shift {
 public:
  // Prepares a shift by this number of steps towards the start of the axis.
  explicit Shift(double steps = 0);
  // Returns the shifted values. Values that are shifted in from beyond the ends of the axis are 0.
  // A constant row (dead sensor) is not changed, because zeros at its ends would hide the fault
  // from fault_of().
  std::vector<float> apply(const std::vector<float>& values) const;
  // Shifts each of the `stride` interleaved columns of a row.
  void apply(std::span<float> row, std::size_t stride) const;

 private:
  std::ptrdiff_t whole_ = 0;
  std::array<float, 8> weights_{};
};

}  // namespace echofuse::recon
