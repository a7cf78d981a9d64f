// SPDX-License-Identifier: MIT
#include "recon/data/features.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "recon/numbers/statistics.hpp"
#include "recon/numbers/text.hpp"

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

void bring_to_strength(std::span<float> values, const std::string& scaling) {
  if (scaling == "record" || scaling == "root") normalise(values);
  if (scaling == "sqrt" || scaling == "root")
    for (float& v : values) v = std::sqrt(std::max(v, 0.f));
}

// Returns the gain that scales columns with these variances to the total variance `wanted`.
float gain_for(std::span<const double> variances, double wanted) {
  const double sum = std::accumulate(variances.begin(), variances.end(), 0.0);
  return sum > 0 ? static_cast<float>(std::sqrt(wanted / sum)) : 1;
}

}  // namespace

void require_zones(const Dataset& data, const Zones& expected) {
  if (expected.empty()) return;
  const std::string path = data.sources.empty() ? "the run" : data.sources.front().path;
  if (data.zones.size() != expected.size())
    throw Error(ExitCode::failed,
                path + ": the detector has " + std::to_string(histograms_of(data.zones)) +
                    " zones; the model expects " + std::to_string(expected.size()));
  for (std::size_t z = 0; z < expected.size(); ++z) {
    const Zone &found = data.zones[z], &own = expected[z];
    if (same_direction(found, own)) continue;
    if (found.has_direction() != own.has_direction())
      throw Error(ExitCode::failed,
                  path + ": the directions of the detector zones are " +
                      (found.has_direction() ? "known, but unknown" : "unknown, but known") +
                      " in the training data");
    throw Error(ExitCode::failed,
                path + formatted(": detector zone %zu is at x %.2f, y %.2f (tangents); the model "
                                 "expects x %.2f, y %.2f; are the zones in another order?",
                                 z, found.x, found.y, own.x, own.y));
  }
}

Matrix Features::raw_inputs(const Dataset& data, const Rows& rows) const {
  require_zones(data, zones);
  const Matrix& histograms = zones.empty() ? data.spd : data.zone_spd;
  Matrix out(rows.size(), count());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto row = out.row(i);
    if (spd_count() > 0) std::copy_n(histograms.row(rows[i]).begin(), spd_count(), row.begin());
    std::copy_n(data.radar.row(rows[i]).begin(), radar_count(),
                row.begin() + static_cast<std::ptrdiff_t>(spd_count()));
  }
  return out;
}

Matrix Features::normalised_inputs(const Dataset& data, const Rows& rows) const {
  Matrix out = raw_inputs(data, rows);
  for (std::size_t i = 0; i < out.rows; ++i) {
    bring_to_strength(out.row(i).first(spd_count()), scaling);
    bring_to_strength(out.row(i).last(radar_count()), scaling);
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
  Features f{inputs, scaling, data.spd_axis, data.radar_axis, {}, 1, 1};
  if (inputs != Inputs::radar) f.zones = data.zones;
  if (scaling == raw_scaling || rows.empty()) {
    if (scaling == raw_scaling && inputs == Inputs::fused) f.array_axis = data.array_axis;
    f.centre.assign(f.count(), 0);
    return f;
  }
  const Matrix table = f.normalised_inputs(data, rows);
  const ColumnStatistics columns = column_statistics(table, all_rows(table.rows));
  f.centre.assign(columns.mean.begin(), columns.mean.end());
  const double wanted = static_cast<double>(f.count()) / (both_sensors(inputs) ? 2 : 1);
  const std::span<const double> variances(columns.variance);
  f.spd_gain = gain_for(variances.first(f.spd_count()), wanted);
  f.radar_gain = gain_for(variances.last(f.radar_count()), wanted);
  return f;
}

}  // namespace echofuse::recon
