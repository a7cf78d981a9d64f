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
  std::vector<double> mean, variance;  // one a column; the variance divided by the number of rows
};

// Mean of each column over `rows`, which is not empty.
std::vector<double> column_means(const Matrix& table, const Rows& rows);
ColumnStatistics column_statistics(const Matrix& table, const Rows& rows);

// True if all values are equal, as of a dead sensor.
bool all_same(std::span<const float> values);

// Divides the values by the sum of those above zero, if there are any.
void share_out(std::span<float> values);

double mean_of(std::span<const double> values);

// Square root of the mean squared deviation: divides by n, which is at least 1.
double standard_deviation(std::span<const double> values);

// Returns the value that this share of all lies below: 0.5 gives the median. It reorders the
// values.
float quantile(std::span<float> values, double share);

// Subtracts the median in place; does nothing without values.
void subtract_median(std::span<float> values);

// Returns the value that this share of all lies above. The largest twentieth is taken to fall off
// exponentially, so that a few hundred values place it.
double upper_limit(std::vector<float> values, double share_above);

// Returns which of `of` records in their order a resample of `count` takes: circular blocks of ten
// neighbours (Politis and Romano 1992), of fewer where there were not five blocks, or all resamples
// would be alike.
Rows resampled_blocks(std::size_t of, std::size_t count, Rng& rng);

// Quantile of each column over `rows`, which is not empty.
std::vector<float> column_quantile(const Matrix& table, const Rows& rows, double share);

}  // namespace echofuse::recon
