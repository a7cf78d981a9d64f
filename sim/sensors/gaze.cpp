// SPDX-License-Identifier: MIT
#include "sim/sensors/gaze.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/core/axis.hpp"
#include "sim/scene/conditions.hpp"

namespace echofuse::sim {
namespace {

double tangent_of(double degrees) { return std::tan(degrees * std::numbers::pi / 180); }

}  // namespace

void Gaze::dim(const Rays& rays, std::int32_t capsules, double* weight, std::size_t count) const {
  const double per_tangent2 = falloff / (half_tangent * half_tangent);
  for (std::size_t i = 0; falloff > 0 && i < count; ++i) {
    const double dx = rays.x[i] - middle_x;
    weight[i] *= std::exp(-per_tangent2 * (dx * dx + rays.y[i] * rays.y[i]));
  }
  for (std::size_t i = 0; room != 1 && i < count; ++i)
    if (rays.shape[i] < 0) weight[i] *= room;
  if (lobe == 1 && plate_lobe == 1) return;
  for (std::size_t i = 0; i < count; ++i) {
    const double n = rays.shape[i] < 0 ? 1 : rays.shape[i] < capsules ? lobe : plate_lobe;
    if (n != 1) weight[i] *= (n + 2) / 3 * std::pow(std::max(rays.cosine[i], 1e-6), n - 1);
  }
}

// Applies the Box-Muller method to the low-discrepancy sequence of the plastic number (Roberts
// 2018).
double Gaze::sway(std::size_t k) const {
  if (sway_m <= 0) return 0;
  const auto turns = [&](double step) {
    const double at = 0.5 + step * static_cast<double>(k + 1);
    return at - std::floor(at);
  };
  return sway_m * std::sqrt(-2 * std::log(1 - turns(0.7548776662466927))) *
         std::cos(2 * std::numbers::pi * turns(0.5698402909980532));
}

Gaze spd_gaze(const Conditions& c) {
  Gaze gaze;
  gaze.extra_m = c.spd_delay_ps / ps_per_m;
  gaze.falloff = c.spd_falloff;
  gaze.half_tangent = c.half_tangent * c.spd_field;
  gaze.middle_x = tangent_of(c.spd_yaw_deg);
  gaze.lobe = gaze.plate_lobe = c.optical_lobe;
  gaze.sway_m = c.slot_sway_m;
  gaze.tangents = c.spd_zones > 1;
  return gaze;
}

Gaze radar_gaze(const Conditions& c) {
  Gaze gaze;
  gaze.sensor_x_m = radar_x_m(c);
  gaze.extra_m = c.radar_bias_m;
  gaze.falloff = c.radar_falloff;
  gaze.half_tangent = radar_half_tangent;
  gaze.middle_x = tangent_of(c.radar_yaw_deg);
  gaze.lobe = c.radar_lobe;
  gaze.plate_lobe = c.radar_plate_lobe;
  gaze.room = c.radar_wall_scatter;
  return gaze;
}

}  // namespace echofuse::sim
