// SPDX-License-Identifier: MIT
// What several measurements of the same thing say of its error.
#pragma once
#include <cmath>
#include <vector>

namespace echofuse::acquire {

// Standard deviation.
inline double spread_of(const std::vector<double>& values) {
  if (values.size() < 2) return 0;
  double mean = 0, squares = 0;
  for (const double v : values) mean += v / static_cast<double>(values.size());
  for (const double v : values) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / static_cast<double>(values.size() - 1));
}

// Noise alone gives the repeats a spread of `expected`; beyond four of its own standard errors
// something moved, and the spread is what the mean is known to.
inline double honest_error(double standard_error, const std::vector<double>& repeats) {
  const auto n = static_cast<double>(repeats.size());
  if (n < 3) return standard_error;
  const double expected = standard_error * std::sqrt(n), seen = spread_of(repeats);
  const bool moved = seen > expected * (1 + 4 / std::sqrt(2 * (n - 1)));
  return moved ? seen / std::sqrt(n) : standard_error;
}

}  // namespace echofuse::acquire
