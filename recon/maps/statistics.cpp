// SPDX-License-Identifier: MIT
#include "recon/maps/statistics.hpp"

#include <algorithm>

namespace echofuse::recon {

ColumnStatistics column_statistics(const Matrix& table, const Rows& rows) {
  const auto n = static_cast<double>(rows.size());
  ColumnStatistics out{std::vector<double>(table.cols), std::vector<double>(table.cols)};
  for (const std::size_t row : rows)
    for (std::size_t c = 0; c < table.cols; ++c) out.mean[c] += double{table.row(row)[c]};
  for (double& mean : out.mean) mean /= n;
  for (const std::size_t row : rows)
    for (std::size_t c = 0; c < table.cols; ++c) {
      const double off = double{table.row(row)[c]} - out.mean[c];
      out.variance[c] += off * off / n;
    }
  return out;
}

float quantile(std::span<float> values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace echofuse::recon
