// SPDX-License-Identifier: MIT
#include "recon/numbers/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace echofuse::recon {

std::vector<double> column_means(const Matrix& table, const Rows& rows) {
  std::vector<double> out(table.cols);
  for (const std::size_t row : rows) {
    const float* const values = table.row(row).data();
    for (std::size_t c = 0; c < out.size(); ++c) out[c] += double{values[c]};
  }
  for (double& mean : out) mean /= static_cast<double>(rows.size());
  return out;
}

ColumnStatistics column_statistics(const Matrix& table, const Rows& rows) {
  const auto n = static_cast<double>(rows.size());
  ColumnStatistics out{column_means(table, rows), std::vector<double>(table.cols)};
  for (const std::size_t row : rows)
    for (std::size_t c = 0; c < table.cols; ++c) {
      const double off = double{table.row(row)[c]} - out.mean[c];
      out.variance[c] += off * off / n;
    }
  return out;
}

double mean_of(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double standard_deviation(std::span<const double> values) {
  const auto n = static_cast<double>(values.size());
  const double mean = mean_of(values);
  double squares = 0;
  for (const double v : values) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / n);
}

Rows resampled_blocks(std::size_t of, std::size_t count, Rng& rng, std::size_t block) {
  std::uniform_int_distribution<std::size_t> any(0, of - 1);
  Rows out;
  while (out.size() < count)
    for (std::size_t k = 0, from = any(rng); k < block && out.size() < count; ++k)
      out.push_back((from + k) % of);
  return out;
}

float quantile(std::span<float> values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

std::vector<float> column_quantile(const Matrix& table, const Rows& rows, double share) {
  std::vector<float> out(table.cols), column(rows.size());
  for (std::size_t c = 0; c < table.cols; ++c) {
    for (std::size_t i = 0; i < rows.size(); ++i) column[i] = table.row(rows[i])[c];
    out[c] = quantile(column, share);
  }
  return out;
}

}  // namespace echofuse::recon
