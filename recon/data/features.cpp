// SPDX-License-Identifier: MIT
#include "recon/data/features.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {

void normalise(std::span<float> values) {
  if (values.empty()) return;
  std::vector<float> sorted(values.begin(), values.end());
  const float background = quantile(sorted, 0.5);
  for (float& v : values) v -= background;
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  // If the sum above the background is not positive (empty scene), all values become zero.
  const double factor = sum > 0 ? 1 / sum : 0;
  for (float& v : values) v = static_cast<float>(v * factor);
}

namespace {

void scale_to_strength(std::span<float> values, const std::string& scaling) {
  if (scaling == "record" || scaling == "root") normalise(values);
  if (scaling == "sqrt" || scaling == "root")
    for (float& v : values) v = std::sqrt(std::max(v, 0.f));
}

// Returns the gain that scales columns with these variances to the total variance `expected`.
float gain_for(std::span<const double> variances, double expected) {
  const double sum = std::accumulate(variances.begin(), variances.end(), 0.0);
  return sum > 0 ? static_cast<float>(std::sqrt(expected / sum)) : 1;
}

}  // namespace

Layout Features::layout() const {
  Layout out = axes;
  if (inputs == Inputs::radar) out.spd = {};
  if (inputs == Inputs::spd) out.radar = {};
  return out;
}

Matrix Features::raw_inputs(const Dataset& data, const Rows& rows) const {
  Matrix out(rows.size(), count());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto to = std::copy_n(data.spd().row(rows[i]).begin(), spd_count(), out.row(i).begin());
    std::copy_n(data.radar().row(rows[i]).begin(), radar_count(), to);
  }
  return out;
}

Matrix Features::normalised_inputs(const Dataset& data, const Rows& rows) const {
  Matrix out = raw_inputs(data, rows);
  for (std::size_t i = 0; i < out.rows; ++i) {
    scale_to_strength(out.row(i).first(spd_count()), scaling);
    scale_to_strength(out.row(i).last(radar_count()), scaling);
  }
  return out;
}

Matrix Features::apply(const Dataset& data, const Rows& rows) const {
  Matrix out = normalised_inputs(data, rows);
  for (std::size_t i = 0; i < out.rows; ++i) {
    const auto row = out.row(i);
    for (std::size_t c = 0; c < row.size(); ++c)
      row[c] = (row[c] - centre[c]) * (c < spd_count() ? spd_gain : radar_gain);
  }
  return out;
}

Features fit_features(const Dataset& data, const Rows& rows, Inputs inputs,
                      const std::string& scaling) {
  Features f{inputs, scaling, {data.spd().axis, data.radar().axis}, {}, 1, 1};
  if (scaling == raw_scaling || rows.empty()) {
    if (scaling == raw_scaling && inputs == Inputs::fused) f.axes.array = data.array().axis;
    f.centre.assign(f.count(), 0);
    return f;
  }
  const Matrix table = f.normalised_inputs(data, rows);
  const ColumnStatistics columns = column_statistics(table, all_rows(table.rows));
  f.centre.assign(columns.mean.begin(), columns.mean.end());
  const double expected = static_cast<double>(f.count()) / (both_sensors(inputs) ? 2 : 1);
  const std::span<const double> variances(columns.variance);
  f.spd_gain = gain_for(variances.first(f.spd_count()), expected);
  f.radar_gain = gain_for(variances.last(f.radar_count()), expected);
  return f;
}

bool shows_sides(const Dataset& data, Inputs inputs) {
  return fit_features(data, {}, inputs, raw_scaling).layout().shows_sides();
}

}  // namespace echofuse::recon
