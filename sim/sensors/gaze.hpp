// SPDX-License-Identifier: MIT
// Position, direction and field of view of a sensor, and the factors of its patch weights in
// addition to the inverse-square law.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>

namespace echofuse::sim {

struct Conditions;

struct Gaze {
  // Rays with directions (x, y, 1), the cosine of incidence, and the number of the shape hit by
  // each ray. Capsules have the lowest numbers; a negative number denotes the room.
  struct Rays {
    const double *x, *y, *cosine;
    const std::int32_t* shape;
  };

  double sensor_x_m = 0, extra_m = 0;  // `extra_m` is added to each range
  double falloff = 0, middle_x = 0, half_tangent = 1;
  double lobe = 1, plate_lobe = 1;  // cosine exponents for capsules and other shapes; 1: Lambertian
  double sway_m = 0;
  double room = 1;  // factor by which the weights of the room are multiplied
  // Height of the sensor above the floor, m. If it is set, Returns::place is filled.
  std::optional<double> height_m{};
  bool tangents = false;  // if true, the tangents of the patches are stored

  // Multiplies the weights of Lambertian surfaces by the falloff and, for the room, by `room`, and
  // replaces the cosine: cos -> (n + 2)/3 cos^n. The factor (n + 2)/3 preserves the integral over
  // the image of a sphere.
  void dim(const Rays& rays, std::int32_t capsules, double* weight, std::size_t count) const;
  // Returns the range offset of patch k due to sway, m. The offsets have the rms value `sway_m`,
  // and those of successive patches are evenly distributed.
  double sway(std::size_t k) const;
};

Gaze spd_gaze(const Conditions& conditions);
Gaze radar_gaze(const Conditions& conditions);

}  // namespace echofuse::sim
