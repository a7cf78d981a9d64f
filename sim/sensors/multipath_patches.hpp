// SPDX-License-Identifier: MIT
// Surface patches that exchange light.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Surface patch that one ray of a sensor meets.
struct Patch {
  Vec3 at, normal;  // relative to the sensor (m); unit vector towards it
  Vec3 direction;   // unit vector from the sensor
  double range_m = 0, albedo = 0;
  double cosine = 0;          // between normal and ray, > 0
  double solid_angle_sr = 0;  // albedo for this sensor
  std::int32_t shape = -1;    // capsules, then plates, then triangles
  std::uint32_t ray = 0;      // row-major

  double area_m2() const { return solid_angle_sr * range_m * range_m / cosine; }
};

// Returns the patches of a scene without its room, from the staggered rays of cast(). Leaves out
// patches at grazing incidence (cosine < 0.02), because their area is undefined.
std::vector<Patch> patches_of(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y);
std::vector<Patch> patches_of(const Room& room, double sensor_x_m, const Axis& x, const Axis& y);

// Returns the share of the light from Lambertian `to` that reaches `from`, per area of `to`. For a
// disc of its size it is
//   F = A cos cos' / (pi d^2 + A)
// as seen from its axis (Howell, Catalog of Radiation Heat Transfer Configuration Factors, B-12,
// times the cosines off the axis). The A in the denominator conserves energy for near patches.
// Returns 0 behind either surface.
double form_factor(const Patch& to, const Patch& from);

}  // namespace echofuse::sim
