// SPDX-License-Identifier: MIT
// Medians and upper limits of numbers, learnt from records that were not used for a fit. There may
// be limits for several widths of the radar response, between which they are interpolated.
#pragma once
#include <span>
#include <vector>

#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

class Limits {
 public:
  // Adds the limits for the next wider response; the first width is 1. `held`: one row per record,
  // one column per number; NaN: unknown. The fraction rates[c] of records exceeds limit c.
  void add(double times_wider, const Matrix& held, std::span<const double> rates);
  // Returns the numbers of a record as shares of their limits: 0 at the median, 1 at the limit.
  std::vector<double> shares(std::span<const double> numbers, double times_wider) const;
  void archive(Archive archive, std::size_t numbers);

 private:
  // For each width, the median and the limit of each number.
  std::vector<double> times_wider_, table_;
};

}  // namespace echofuse::recon
