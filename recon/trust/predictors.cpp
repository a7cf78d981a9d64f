// SPDX-License-Identifier: MIT
#include "recon/trust/predictors.hpp"

#include <algorithm>
#include <cmath>

#include "recon/metrics/metrics.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

float significance(std::span<const float> counts) {
  std::vector<float> sorted(counts.begin(), counts.end());
  const float level = quantile(sorted, 0.5);
  double above = 0, all = 0;
  for (const float v : counts) above += double{v - level}, all += double{v};
  return static_cast<float>(std::max(above, 0.0) / std::sqrt(all + 1));
}

}  // namespace

float peak_to_noise(std::span<const float> power) {
  std::vector<float> sorted(power.begin(), power.end());
  std::sort(sorted.begin(), sorted.end());
  const std::size_t half = sorted.size() / 2;
  double mean = 0, square = 0;
  for (std::size_t i = 0; i <= half; ++i) mean += double{sorted[i]} / double(half + 1);
  for (std::size_t i = 0; i <= half; ++i)
    square += std::pow(double{sorted[i]} - mean, 2) / double(half + 1);
  return static_cast<float>((double{sorted.back()} - mean) / std::max(std::sqrt(square), 1e-12));
}

std::size_t predictor_count(Inputs inputs) { return both_sensors(inputs) ? 3 : 2; }

Matrix predictors_of(const Matrix& maps, const Scene& scene, const Dataset& data, const Rows& rows,
                     Inputs inputs) {
  Matrix out(rows.size(), predictor_count(inputs));
  for_each_part(rows.size(), [&](std::size_t i) {
    const auto row = out.row(i);
    row.front() = static_cast<float>(std::abs(foreground_tangent(maps.row(i), scene)));
    if (inputs != Inputs::radar) row[1] = std::log(significance(data.spd.row(rows[i])) + 1);
    if (inputs != Inputs::spd) row.back() = std::log(peak_to_noise(data.radar.row(rows[i])));
  });
  return out;
}

}  // namespace echofuse::recon
