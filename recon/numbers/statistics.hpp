// SPDX-License-Identifier: MIT
// What the rows of a table have in common.
#pragma once
#include <span>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct ColumnStatistics {
  std::vector<double> mean, variance;  // of each column; the variance divided by the number of rows
};

// Of the given rows (at least one).
ColumnStatistics column_statistics(const Matrix& table, const Rows& rows);

// Divided by their number (at least one).
double standard_deviation(std::span<const double> values);

// The value that this share of all is below: 0.5 for the median. Reorders them.
float quantile(std::span<float> values, double share);

// Of each column, over the given rows (at least one).
std::vector<float> column_quantile(const Matrix& table, const Rows& rows, double share);

}  // namespace echofuse::recon
