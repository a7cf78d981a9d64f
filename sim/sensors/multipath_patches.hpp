// SPDX-License-Identifier: MIT
// Surfaces are cut into patches, which send each other light.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Surface patch that one ray of a sensor meets.
struct Patch {
  Vec3 at, normal;  // relative to the sensor (m); of length 1, towards it
  Vec3 direction;   // from the sensor, of length 1
  double range_m = 0, albedo = 0;
  double cosine = 0;          // between normal and ray, > 0
  double solid_angle_sr = 0;  // as the sensor sees it
  std::int32_t shape = -1;    // capsules, then plates, then triangles
  std::uint32_t ray = 0;      // row-major

  double area_m2() const { return solid_angle_sr * range_m * range_m / cosine; }
};

// Patches of a scene without its room, by the staggered rays of cast(). Patches seen from the edge
// (cosine < 0.02) are left out, because their area is not known.
std::vector<Patch> patches_of(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y);
std::vector<Patch> patches_of(const Room& room, double sensor_x_m, const Axis& x, const Axis& y);

// Share of what Lambertian `to` sends that meets `from`, per area of `to`. For a disc of its size
// it is
//   F = A cos cos' / (pi d^2 + A)
// as seen from its axis (Howell, Catalog of Radiation Heat Transfer Configuration Factors, B-12,
// thinned by the cosines off the axis). The A below keeps near patches from sending more than there
// is. It is 0 behind either surface.
double form_factor(const Patch& to, const Patch& from);

}  // namespace echofuse::sim
