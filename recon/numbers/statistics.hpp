// SPDX-License-Identifier: MIT
#pragma once
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct ColumnStatistics {
  // One value per column. The variance is the sum of squared deviations divided by the number of
  // rows.
  std::vector<double> mean, variance;
};

// Returns the mean of each column over `rows`, which must not be empty.
std::vector<double> column_means(const Matrix& table, const Rows& rows);
ColumnStatistics column_statistics(const Matrix& table, const Rows& rows);

// Returns true if all values are equal, as for a dead sensor.
bool all_same(std::span<const float> values);

// Divides all values by the sum of the positive values; does nothing if no value is positive.
void share_out(std::span<float> values);

double mean_of(std::span<const double> values);

// Returns Pearson's correlation coefficient of two lists of the same length; 0 if one is constant.
double correlation(std::span<const double> a, std::span<const double> b);
// Fisher's z-transform of a correlation of n pairs; its standard error is 1 / sqrt(n - 3).
double fisher_z(double correlation);

// Returns the standard deviation, with the number of values as divisor. Requires at least one
// value.
double standard_deviation(std::span<const double> values);

// Standard deviation, in points, and skewness of a distribution over points. `weight` converts the
// value of a point to its weight.
struct Moments {
  double deviation = NAN, skewness = NAN;
};
Moments moments_of(std::span<const float> values, double (*weight)(double));

// Returns the value below which the fraction `share` of the values lies (0.5: the median). Reorders
// the values.
float quantile(std::span<float> values, double share);

// Subtracts the median in place; does nothing if there are no values.
void subtract_median(std::span<float> values);

// Returns the height of a profile's peak above the mean of its weaker half, divided by the standard
// deviation of that half.
float peak_to_noise(std::span<const float> power);

// Interpolates linearly between the rows of a table, which belong to ascending points. The result
// is constant beyond them.
std::vector<double> interpolated(std::span<const double> points, std::span<const double> table,
                                 double at);

// Returns the limit exceeded by the fraction `share_above` of all values. Fits an exponential tail
// to the largest 5 % of the values, so that a few hundred values are enough.
double upper_limit(std::vector<float> values, double share_above);

// Returns the rows of a block bootstrap: samples `count` rows from `of` consecutive records, in
// circular blocks of ten (Politis and Romano, 1992). If there are fewer than 50 records, the blocks
// are shorter, because resamples of a few blocks would be too similar.
Rows resampled_blocks(std::size_t of, std::size_t count, Rng& rng);

// Returns the quantile `share` of each column over `rows`, which must not be empty.
std::vector<float> column_quantile(const Matrix& table, const Rows& rows, double share);

}  // namespace echofuse::recon
