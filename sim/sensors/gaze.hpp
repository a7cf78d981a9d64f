// SPDX-License-Identifier: MIT
// Position, direction and field of view of a sensor, and the weights of its patches in addition to
// the inverse-square law.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>

namespace echofuse::sim {

struct Conditions;

struct Gaze {
  // Each ray has direction (x, y, 1), the cosine of incidence, and the number of the shape:
  // capsules first; negative: the room.
  struct Rays {
    const double *x, *y, *cosine;
    const std::int32_t* shape;
  };

  double sensor_x_m = 0, extra_m = 0;  // extra_m is added to every reported range
  double falloff = 0, middle_x = 0, half_tangent = 1;
  double lobe = 1, plate_lobe = 1;  // exponents of the cosine; 1: Lambert
  double sway_m = 0;
  double room = 1;                   // factor of the room's light or echo
  std::optional<double> height_m{};  // sensor height above the floor; if set, places are kept
  bool zones = false;                // true: directions are kept

  // Converts weights of Lambert's law to those of the lobes, and applies the falloff:
  //   cos -> (n + 2)/3 cos^n, which keeps the integral over a sphere's image.
  void dim(const Rays& rays, std::int32_t capsules, double* weight, std::size_t count) const;
  // Returns the extra range of patch k, m: values of rms sway_m, evenly spread over any run of k.
  double sway(std::size_t k) const;
};

Gaze spd_gaze(const Conditions& conditions);
Gaze radar_gaze(const Conditions& conditions);

}  // namespace echofuse::sim
