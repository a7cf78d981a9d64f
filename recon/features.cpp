// SPDX-License-Identifier: MIT
#include "recon/features.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace echofuse::recon {
namespace {

float median_of(std::span<const float> values) {
  std::vector<float> sorted(values.begin(), values.end());
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

void normalise(std::span<float> values) {
  if (values.empty()) return;
  const float background = median_of(values);
  for (float& v : values) v -= background;
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  // Nothing above the background: an empty scene stays an empty profile.
  const double factor = sum > 0 ? 1 / sum : 0;
  for (float& v : values) v = static_cast<float>(v * factor);
}

void bring_to_strength(std::span<float> values, const std::string& scaling) {
  if (scaling == "sqrt")
    for (float& v : values) v = std::sqrt(std::max(v, 0.f));
  else if (scaling == "record")
    normalise(values);
}

std::vector<float> column_means(const Matrix& table) {
  std::vector<double> sum(table.cols);
  for (std::size_t i = 0; i < table.rows; ++i)
    for (std::size_t c = 0; c < table.cols; ++c) sum[c] += table.row(i)[c];
  std::vector<float> out(table.cols);
  for (std::size_t c = 0; c < out.size(); ++c)
    out[c] = static_cast<float>(sum[c] / static_cast<double>(table.rows));
  return out;
}

// The factor that brings the columns [first, first + count) to a total variance of `wanted`.
float gain_for(const Matrix& table, const std::vector<float>& centre, std::size_t first,
               std::size_t count, double wanted) {
  double sum = 0;
  for (std::size_t i = 0; i < table.rows; ++i)
    for (std::size_t c = first; c < first + count; ++c)
      sum += std::pow(double{table.row(i)[c]} - double{centre[c]}, 2);
  return sum > 0 ? static_cast<float>(std::sqrt(wanted * static_cast<double>(table.rows) / sum))
                 : 1;
}

}  // namespace

Matrix Features::strengths(const Dataset& data, const Rows& rows) const {
  Matrix out(rows.size(), count());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto row = out.row(i);
    std::copy_n(data.spd.row(rows[i]).begin(), spd_count(), row.begin());
    std::copy_n(data.radar.row(rows[i]).begin(), radar_count(),
                row.begin() + static_cast<std::ptrdiff_t>(spd_count()));
    bring_to_strength(row.first(spd_count()), scaling);
    bring_to_strength(row.last(radar_count()), scaling);
  }
  return out;
}

Matrix Features::apply(const Dataset& data, const Rows& rows) const {
  Matrix out = strengths(data, rows);
  for (std::size_t i = 0; i < out.rows; ++i) {
    const auto row = out.row(i);
    for (std::size_t c = 0; c < row.size(); ++c)
      row[c] = (row[c] - centre[c]) * (c < spd_count() ? spd_gain : radar_gain);
  }
  return out;
}

Features fit_features(const Dataset& data, const Rows& rows, Inputs inputs,
                      const std::string& scaling) {
  Features f{inputs, scaling, data.spd_axis, data.radar_axis, {}, 1, 1};
  if (scaling == raw_scaling) {
    f.centre.assign(f.count(), 0);
    return f;
  }
  const Matrix table = f.strengths(data, rows);
  f.centre = column_means(table);
  const double wanted = static_cast<double>(f.count()) / (inputs == Inputs::fused ? 2 : 1);
  f.spd_gain = gain_for(table, f.centre, 0, f.spd_count(), wanted);
  f.radar_gain = gain_for(table, f.centre, f.spd_count(), f.radar_count(), wanted);
  return f;
}

}  // namespace echofuse::recon
