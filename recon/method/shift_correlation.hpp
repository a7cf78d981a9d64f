// SPDX-License-Identifier: MIT
// How well a radar profile fits a histogram at each shift between them. The profile that a body
// would have is its histogram, blurred by the radar's point spread; its correlation with the
// profile over shifts has the most information where the side is, as a product of both inputs that
// a small network would have to learn.
#pragma once
#include <cstddef>
#include <span>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

class ShiftCorrelation {
 public:
  // Of `count` points: first + i * step, metres from the body's range.
  struct Points {
    double first_m, step_m;
    std::size_t count;
  };
  ShiftCorrelation() = default;
  // resolution_m: of the radar, c/2B. Shifts of the profile to longer ranges, metres.
  ShiftCorrelation(const Points& histogram, const Points& profile, double resolution_m,
                   double shift_from_m, double shift_to_m);

  std::size_t shifts() const { return shifts_; }
  std::size_t cost() const;  // multiply-adds
  // Cosine between the profile and the histogram's, for each shift, from the
  // longest to the shortest.
  void operator()(std::span<const float> histogram, std::span<const float> profile,
                  std::span<float> out) const;

 private:
  std::size_t shifts_ = 0;
  Matrix blur_;  // bins of the histogram x points of the expected profile
};

}  // namespace echofuse::recon
