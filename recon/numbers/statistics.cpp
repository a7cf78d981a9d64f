// SPDX-License-Identifier: MIT
#include "recon/numbers/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>

#include "drivers/core/clones.hpp"

namespace echofuse::recon {
namespace {

ECHOFUSE_CLONES void add_row(const float* values, std::size_t count, double* sums) {
  for (std::size_t i = 0; i < count; ++i) sums[i] += double{values[i]};
}

}  // namespace

std::vector<double> column_means(const Matrix& table, const Rows& rows) {
  std::vector<double> out(table.cols);
  for (const std::size_t row : rows) add_row(table.row(row).data(), out.size(), out.data());
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

bool all_same(std::span<const float> values) {
  return std::adjacent_find(values.begin(), values.end(), std::not_equal_to<>()) == values.end();
}

void share_out(std::span<float> values) {
  float all = 0;
  for (const float v : values) all += std::max(v, 0.f);
  if (all > 0)
    for (float& v : values) v /= all;
}

double mean_of(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double correlation(std::span<const double> a, std::span<const double> b) {
  const double mean_a = mean_of(a), mean_b = mean_of(b);
  double aa = 0, bb = 0, ab = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    aa += (a[i] - mean_a) * (a[i] - mean_a), bb += (b[i] - mean_b) * (b[i] - mean_b);
    ab += (a[i] - mean_a) * (b[i] - mean_b);
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

double fisher_z(double correlation) { return std::atanh(std::clamp(correlation, -0.999, 0.999)); }

double standard_deviation(std::span<const double> values) {
  const auto n = static_cast<double>(values.size());
  const double mean = mean_of(values);
  double squares = 0;
  for (const double v : values) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / n);
}

Moments moments_of(std::span<const float> values, double (*weight)(double)) {
  double sum = 1e-12, first = 0, second = 0, third = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double w = weight(double{values[i]});
    sum += w, first += w * static_cast<double>(i);
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double w = weight(double{values[i]}), off = static_cast<double>(i) - first / sum;
    second += w * off * off, third += w * off * off * off;
  }
  const double deviation = std::sqrt(second / sum + 1e-6);
  return {deviation, third / sum / std::pow(deviation, 3)};
}

float peak_to_noise(std::span<const float> power) {
  std::vector<double> sorted(power.begin(), power.end());
  std::sort(sorted.begin(), sorted.end());
  const std::span weaker(sorted.data(), sorted.size() / 2 + 1);
  return static_cast<float>((sorted.back() - mean_of(weaker)) /
                            std::max(standard_deviation(weaker), 1e-12));
}

std::vector<double> interpolated(std::span<const double> points, std::span<const double> table,
                                 double at) {
  std::vector<double> out(table.begin(), table.begin() + std::ssize(table) / std::ssize(points));
  for (std::size_t k = 1; k < points.size(); ++k) {
    const double t = std::clamp((at - points[k - 1]) / (points[k] - points[k - 1]), 0., 1.);
    for (std::size_t c = 0; c < out.size(); ++c)
      out[c] = std::lerp(out[c], table[k * out.size() + c], t);
  }
  return out;
}

double upper_limit(std::vector<float> values, double share_above) {
  constexpr double tail = 0.05;
  const double start = double{quantile(values, 1 - tail)};
  double excess = 0, count = 0;
  for (const float v : values)
    if (double{v} > start) excess += double{v} - start, ++count;
  return start + (count > 0 ? excess / count : 0) * std::log(tail / share_above);
}

Rows resampled_blocks(std::size_t of, std::size_t count, Rng& rng) {
  // Block length in records. Ten records take about half a minute, and a person may keep a pose
  // this long.
  constexpr std::size_t pose_records = 10;
  constexpr std::size_t min_blocks = 5;
  const std::size_t block = std::clamp<std::size_t>(of / min_blocks, 1, pose_records);
  std::uniform_int_distribution<std::size_t> any(0, of - 1);
  Rows out;
  while (out.size() < count)
    for (std::size_t first = any(rng), k = 0; k < block && out.size() < count; ++k)
      out.push_back((first + k) % of);
  return out;
}

float quantile(std::span<float> values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

void subtract_median(std::span<float> values) {
  if (values.empty()) return;
  std::vector<float> sorted(values.begin(), values.end());
  const float median = quantile(sorted, 0.5);
  for (float& v : values) v -= median;
}

std::vector<float> column_quantile(const Matrix& table, const Rows& rows, double share) {
  // Number of columns processed at a time: one cache line of each row.
  constexpr std::size_t block_columns = 16;
  std::vector<float> out(table.cols);
  std::vector<std::vector<float>> columns(block_columns, std::vector<float>(rows.size()));
  for (std::size_t first = 0; first < table.cols; first += block_columns) {
    const std::size_t count = std::min(block_columns, table.cols - first);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const auto values = table.row(rows[i]).subspan(first, count);
      for (std::size_t c = 0; c < count; ++c) columns[c][i] = values[c];
    }
    for (std::size_t c = 0; c < count; ++c) out[first + c] = quantile(columns[c], share);
  }
  return out;
}

}  // namespace echofuse::recon
