// SPDX-License-Identifier: MIT
#include "recon/numbers/permutation_test.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

using Eigen::ArrayXd, Eigen::MatrixXd, Eigen::VectorXd, Eigen::Index;

constexpr Index block = 10;  // number of successive records
constexpr Index permutations = 4000;
constexpr std::uint64_t permutation_stream = 0x646f6d61;  // "doma" in ASCII
// Minimum standard error, relative to that of independent records with a standard deviation of 1.
constexpr double min_error_share = 0.7;
// Squared deviations are clipped to this value, so that a single outlier has little weight.
constexpr double max_square = 16;

// Returns the standard deviation of each column. It is infinite if at most half of the values are
// known, so that all deviations from the mean are 0. `mean`: set to the means, or 0.
std::vector<double> deviations_of(const Matrix& table, std::span<const double> floors,
                                  std::vector<double>& mean) {
  std::vector<double> out(table.cols, INFINITY);
  mean.assign(table.cols, 0);
  for (std::size_t c = 0; c < table.cols; ++c) {
    std::vector<double> values;
    for (std::size_t i = 0; i < table.rows; ++i)
      if (const auto v = double{table.row(i)[c]}; !std::isnan(v)) values.push_back(v);
    if (2 * values.size() > table.rows)
      mean[c] = mean_of(values), out[c] = std::max(standard_deviation(values), floors[c]);
  }
  return out;
}

// Returns the means of blocks of ten successive rows, and drops the remaining rows. The columns are
// the deviations of the values, in standard deviations, then the squares of these deviations. Both
// are zero for an unknown value.
MatrixXd block_means(const Matrix& table, const std::vector<double>& mean,
                     const std::vector<double>& deviation) {
  MatrixXd rows = MatrixXd::Zero(Index(table.rows), Index(2 * table.cols));
  for (std::size_t i = 0; i < table.rows; ++i)
    for (std::size_t c = 0; c < table.cols; ++c) {
      const double v = (double{table.row(i)[c]} - mean[c]) / deviation[c];
      if (std::isnan(v)) continue;
      rows(Index(i), Index(c)) = v;
      rows(Index(i), Index(table.cols + c)) = std::min(v * v, max_square);
    }
  MatrixXd out(rows.rows() / block, rows.cols());
  for (Index b = 0; b < out.rows(); ++b)
    out.row(b) = rows.middleRows(b * block, block).colwise().mean();
  return out;
}

// Selects `drawn` blocks at random, several thousand times. Returns one row per selection: the mean
// of the selected blocks minus the mean of the other blocks.
MatrixXd permuted(const MatrixXd& blocks, Index drawn) {
  const VectorXd all = blocks.colwise().sum();
  const auto others = static_cast<double>(blocks.rows() - drawn);
  Rng rng = make_rng(static_cast<std::uint64_t>(blocks.rows()), permutation_stream);
  std::vector<Index> order(static_cast<std::size_t>(blocks.rows()));
  std::iota(order.begin(), order.end(), 0);
  MatrixXd out(permutations, blocks.cols());
  for (Index k = 0; k < permutations; ++k) {
    VectorXd some = VectorXd::Zero(blocks.cols());
    for (std::size_t i = 0; i < static_cast<std::size_t>(drawn); ++i) {
      std::uniform_int_distribution<std::size_t> from(i, order.size() - 1);
      std::swap(order[i], order[from(rng)]);
      some += blocks.row(order[i]).transpose();
    }
    out.row(k) = some / static_cast<double>(drawn) - (all - some) / others;
  }
  return out;
}

// Returns the standard errors of the difference between two means, estimated from the variance
// between blocks.
ArrayXd standard_errors(const MatrixXd& a, const MatrixXd& b) {
  const auto about_mean = [](const MatrixXd& m) -> ArrayXd {
    return (m.rowwise() - m.colwise().mean()).array().square().colwise().sum().transpose();
  };
  const auto n = static_cast<double>(a.rows()), m = static_cast<double>(b.rows());
  return ((about_mean(a) + about_mean(b)) / std::max(n + m - 2, 1.) * (1 / n + 1 / m)).sqrt();
}

}  // namespace

TableDifference compare_tables(const Matrix& known, const Matrix& found,
                               std::span<const double> floors) {
  std::vector<double> mean, own_mean, deviation = deviations_of(known, floors, mean);
  const std::vector<double> own = deviations_of(found, floors, own_mean);
  for (std::size_t c = 0; c < own.size(); ++c)
    if (std::isinf(own[c])) deviation[c] = INFINITY;
  const MatrixXd before = block_means(known, mean, deviation),
                 now = block_means(found, mean, deviation);
  const VectorXd difference = now.colwise().mean() - before.colwise().mean();
  const double min_error = min_error_share * std::sqrt(1. / static_cast<double>(found.rows) +
                                                       1. / static_cast<double>(known.rows));
  const ArrayXd error = standard_errors(before, now).max(min_error);
  MatrixXd both(before.rows() + now.rows(), before.cols());
  both << before, now;
  const MatrixXd chance = permuted(both, now.rows());
  const ArrayXd chance_error = chance.array().square().colwise().mean().sqrt().max(min_error);
  const auto largest = [&](const VectorXd& v) {
    return (v.array() / chance_error).abs().maxCoeff();
  };
  const double of_found = largest(difference);
  Index above = 0;
  for (Index k = 0; k < permutations; ++k) above += largest(chance.row(k)) >= of_found;
  return {deviation,
          {difference.begin(), difference.end()},
          {error.begin(), error.end()},
          static_cast<double>(above + 1) / static_cast<double>(permutations + 1)};
}

}  // namespace echofuse::recon
