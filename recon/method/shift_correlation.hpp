// SPDX-License-Identifier: MIT
// Correlation of radar profile and histogram at each shift between them. The expected profile of a
// body is its histogram, blurred by the radar's point spread. Its correlation with the profile over
// shifts has the most information on which side the body is. It is a product of both inputs that a
// small network would otherwise have to learn.
#pragma once
#include <cstddef>
#include <span>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

class ShiftCorrelation {
 public:
  // There are `count` points at first + i * step, in metres from the body's range.
  struct Points {
    double first_m, step_m;
    std::size_t count;
  };
  ShiftCorrelation() = default;
  // resolution_m is c/2B of the radar. The profile is shifted to longer ranges by shift_from_m to
  // shift_to_m, in metres.
  ShiftCorrelation(const Points& histogram, const Points& profile, double resolution_m,
                   double shift_from_m, double shift_to_m);

  std::size_t shifts() const { return shifts_; }
  std::size_t cost() const;  // multiply-adds
  // Computes the cosine between the profile and the profile expected from the histogram, for each
  // shift, from the longest to the shortest.
  void operator()(std::span<const float> histogram, std::span<const float> profile,
                  std::span<float> out) const;

 private:
  std::size_t shifts_ = 0;
  Matrix blur_;  // bins of the histogram x points of the expected profile
};

}  // namespace echofuse::recon
