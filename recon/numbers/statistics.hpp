// SPDX-License-Identifier: MIT
// What the rows of a table have in common.
#pragma once
#include <span>
#include <utility>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct ColumnStatistics {
  std::vector<double> mean, variance;  // of each column; the variance divided by the number of rows
};

// Of the given rows (at least one).
std::vector<double> column_means(const Matrix& table, const Rows& rows);
ColumnStatistics column_statistics(const Matrix& table, const Rows& rows);

// As of a sensor that is dead.
bool all_same(std::span<const float> values);

// Divides by the sum of what is above zero, if anything is.
void share_out(std::span<float> values);

double mean_of(std::span<const double> values);

// Divided by their number (at least one).
double standard_deviation(std::span<const double> values);

// The value that this share of all is below: 0.5 for the median. Reorders them.
float quantile(std::span<float> values, double share);

// In place; of none nothing.
void subtract_median(std::span<float> values);

// The value that this share of all is above: the largest twentieth is taken to fall off
// exponentially, so that a few hundred values place it.
double upper_limit(std::vector<float> values, double share_above);

// Which of `of` records in their order a resample of `count` takes: circular blocks (Politis and
// Romano 1992). More than some blocks are needed, or all resamples are alike.
Rows resampled_blocks(std::size_t of, std::size_t count, Rng& rng);

// Of each column, over the given rows (at least one).
std::vector<float> column_quantile(const Matrix& table, const Rows& rows, double share);

}  // namespace echofuse::recon
