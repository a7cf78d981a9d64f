// SPDX-License-Identifier: MIT
// A gaze says where a sensor is and where it points, and how it weights its view beside the inverse
// squares.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>

namespace echofuse::sim {

struct Conditions;

struct Gaze {
  // Each ray has (x, y, 1), the cosine of the incidence, and the number of the shape: capsules come
  // first, and a number below 0 is the room.
  struct Rays {
    const double *x, *y, *cosine;
    const std::int32_t* shape;
  };

  double sensor_x_m = 0, extra_m = 0;  // extra is added to every range that it shows
  double falloff = 0, middle_x = 0, half_tangent = 1;
  double lobe = 1, plate_lobe = 1;  // powers of the cosine; 1: Lambert
  double sway_m = 0;
  double room = 1;                   // factor of the room's light or echo
  std::optional<double> height_m{};  // sensor above the floor; if set, places are kept
  bool zones = false;                // true: directions are kept

  // Weights of Lambert's law become those of the lobes, and fall off from the middle:
  //   cos -> (n + 2)/3 cos^n, with which a sphere's image integrates to the same.
  void dim(const Rays& rays, std::int32_t capsules, double* weight, std::size_t count) const;
  // Extra range of patch k, in metres: deviates of rms sway_m that spread evenly for any run of k.
  double sway(std::size_t k) const;
};

Gaze spd_gaze(const Conditions& conditions);
Gaze radar_gaze(const Conditions& conditions);

}  // namespace echofuse::sim
