// SPDX-License-Identifier: MIT
// Surface patches that exchange light or echoes.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Part of a surface hit by one ray of a sensor.
struct Patch {
  Vec3 at, normal;  // position relative to the sensor, m; unit normal facing the sensor
  Vec3 direction;   // unit vector from the sensor to the patch
  double range_m = 0, albedo = 0;
  double cosine = 0;          // |cos| of the angle between the normal and the ray
  double solid_angle_sr = 0;  // solid angle of the ray at the sensor
  std::int32_t shape = -1;    // shape number: capsules, then plates, then triangles
  std::uint32_t ray = 0;      // index of the ray, row-major

  double area_m2() const { return solid_angle_sr * range_m * range_m / cosine; }
};

// Returns the patches of a scene without its room: one for each ray of cast() with
// Sampling::staggered that meets a surface. Omits patches at grazing incidence (cosine < 0.02),
// where the area is undefined.
std::vector<Patch> patches_of(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y);
std::vector<Patch> patches_of(const Room& room, double sensor_x_m, const Axis& x, const Axis& y);

// Returns the form factor between two Lambertian patches: irradiance of `to` / exitance of `from`.
// It is F = A cos cos' / (pi d^2 + A) with the area A of `from` and the distance d. On the axis of
// a disc this is exact (Howell, Catalog of Radiation Heat Transfer Configuration Factors, B-12).
// The term A in the denominator conserves energy for near patches. F is 0 if one patch is behind
// the other.
double form_factor(const Patch& to, const Patch& from);

}  // namespace echofuse::sim
