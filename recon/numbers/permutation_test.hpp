// SPDX-License-Identifier: MIT
// Compares two tables of records by a permutation test: the mean of each column, and the mean of
// its squared deviations. The statistic is the largest difference in units of its standard
// deviation over the permutations, which corrects for multiple tests (Westfall and Young,
// Resampling-Based Multiple Testing, 1993; Good, Permutation Tests, 2000). The test exchanges
// blocks of ten successive records, because a pose may last for several records.
#pragma once
#include <span>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct TableDifference {
  // Standard deviation of each column in `known`; infinite if the column is unknown in most rows of
  // one of the tables, so that its differences are 0.
  std::vector<double> deviation;
  // Differences of the means in standard deviations, then of the variances in units of the variance
  // in `known`, and their standard errors: two values per column.
  std::vector<double> difference, error;
  double p = 1;  // probability that a table like `known` would differ by at least this much
};
// The tables have one row per record, in record order, and at least ten rows. NaN: unknown.
// `floors`: lower limits of the standard deviations.
TableDifference compare_tables(const Matrix& known, const Matrix& found,
                               std::span<const double> floors);

}  // namespace echofuse::recon
