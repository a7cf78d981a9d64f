// SPDX-License-Identifier: MIT
// Statistics of the rows of a table.
#pragma once
#include <span>
#include <utility>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct ColumnStatistics {
  std::vector<double> mean,
      variance;  // one per column; the variance is divided by the number of rows
};

// Mean of each column over `rows`, which must not be empty.
std::vector<double> column_means(const Matrix& table, const Rows& rows);
ColumnStatistics column_statistics(const Matrix& table, const Rows& rows);

// True if all values are equal, as for a dead sensor.
bool all_same(std::span<const float> values);

// Divides the values by the sum of the positive ones, if there are any.
void share_out(std::span<float> values);

double mean_of(std::span<const double> values);

// Root mean squared deviation: divides by n, which must be at least 1.
double standard_deviation(std::span<const double> values);

// Returns the quantile at this share (0.5: the median). Reorders the values.
float quantile(std::span<float> values, double share);

// Subtracts the median in place; does nothing without values.
void subtract_median(std::span<float> values);

// Returns the value that this share of all values exceeds. Fits an exponential tail to the largest
// twentieth, so that a few hundred values are enough.
double upper_limit(std::vector<float> values, double share_above);

// Returns the records of a block bootstrap: `count` of `of` consecutive records, in circular blocks
// of ten (Politis and Romano 1992). The blocks are shorter if there were fewer than five, because
// all resamples would be alike.
Rows resampled_blocks(std::size_t of, std::size_t count, Rng& rng);

// Quantile of each column over `rows`, which must not be empty.
std::vector<float> column_quantile(const Matrix& table, const Rows& rows, double share);

}  // namespace echofuse::recon
