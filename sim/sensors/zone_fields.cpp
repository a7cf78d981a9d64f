// SPDX-License-Identifier: MIT
#include "sim/sensors/zone_fields.hpp"

#include <cmath>
#include <numbers>

#include "sim/sensors/gaze.hpp"
#include "sim/sensors/optics.hpp"

namespace echofuse::sim {
namespace {

std::size_t zones_a_side(const Conditions& c) { return static_cast<std::size_t>(c.spd_zones); }

double pitch(const Conditions& c) {
  return 2 * spd_gaze(c).half_tangent / static_cast<double>(c.spd_zones);
}

// Returns the centre of zone i along one side, as a tangent relative to the axis of the detector.
double centre(const Conditions& c, std::size_t i) {
  return (static_cast<double>(i) + 0.5 - static_cast<double>(c.spd_zones) / 2) * pitch(c);
}

// For each zone along one side and each tangent, returns the fraction of the light from this
// tangent that falls on the zone: [zone][tangent].
std::vector<double> shares(const std::vector<float>& tangents, double middle, const Conditions& c) {
  const std::size_t side = zones_a_side(c), count = tangents.size();
  const double deviation = zone_deviation * pitch(c);
  std::vector<double> out(side * count), sum(count);
  for (std::size_t i = 0; i < side; ++i)
    for (std::size_t k = 0; k < count; ++k) {
      const double off = (double{tangents[k]} - middle - centre(c, i)) / deviation;
      sum[k] += out[i * count + k] = std::exp(-off * off / 2);
    }
  for (std::size_t i = 0; i < out.size(); ++i) out[i] /= sum[i % count];
  return out;
}

}  // namespace

Zones zones_of(const Conditions& c) {
  const double fwhm = 2 * std::sqrt(2 * std::numbers::ln2) * zone_deviation * pitch(c);
  if (c.spd_zones == 1) return single_pixel();
  Zones out;
  for (std::size_t row = 0; row < zones_a_side(c); ++row)
    for (std::size_t column = 0; column < zones_a_side(c); ++column)
      out.push_back({centre(c, column), -centre(c, row), fwhm, 0});
  return out;
}

std::vector<double> zone_rates(const Returns& returns, const Conditions& c) {
  if (c.spd_zones == 1) return spd_rate(returns, c);
  const std::size_t side = zones_a_side(c), count = returns.range_m.size();
  const std::vector<double> across = shares(returns.tangent_x, spd_gaze(c).middle_x, c);
  const std::vector<double> up = shares(returns.tangent_y, 0, c);
  Conditions of_zone = c;
  of_zone.background_counts /= static_cast<double>(side * side);
  Returns dimmed{returns.range_m, returns.weight};
  std::vector<double> out;
  for (std::size_t row = 0; row < side; ++row)
    for (std::size_t column = 0; column < side; ++column) {
      const double *x = &across[column * count], *y = &up[(side - 1 - row) * count];
      for (std::size_t k = 0; k < count; ++k) dimmed.weight[k] = returns.weight[k] * x[k] * y[k];
      const std::vector<double> rate = spd_rate(dimmed, of_zone);
      out.insert(out.end(), rate.begin(), rate.end());
    }
  return out;
}

std::vector<std::uint32_t> draw_zone_counts(const std::vector<double>& rates, const Conditions& c,
                                            Rng& rng) {
  std::vector<std::uint32_t> out;
  for (auto from = rates.begin(); from < rates.end(); from += c.bins) {
    const std::vector<std::uint32_t> counts = draw_counts({from, from + c.bins}, c, rng);
    out.insert(out.end(), counts.begin(), counts.end());
  }
  return out;
}

}  // namespace echofuse::sim
