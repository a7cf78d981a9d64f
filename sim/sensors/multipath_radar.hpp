// SPDX-License-Identifier: MIT
// Echoes of a radar or of sound from specular walls, by image sources (Allen and Berkley, J.
// Acoust. Soc. Am. 65, 943, 1979).
#pragma once
#include <array>
#include <optional>
#include <vector>

#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Gaze;

// Mirror image of a sensor in the walls.
struct ImageSource {
  Vec3 at;
  std::array<const Plate*, 2> walls{};  // reflecting walls, in order
  int reflections = 0;                  // 0: the sensor itself
};
// Returns the sensor itself and its images in the room's first `walls` plates, with at most `order`
// reflections (0 to 2).
std::vector<ImageSource> image_sources(const Room& room, Vec3 sensor, int order);

struct Way {
  Vec3 departure;  // unit vector at the sensor
  Vec3 arrival;    // unit vector at the place
  double length_m = 0;
};
// Returns the path from the sensor to a place; nothing if a reflection point is outside its wall.
// Ignores obstacles.
std::optional<Way> way_to(const ImageSource& image, Vec3 sensor, Vec3 place);

// Adds the echoes of patches visible to the radar, out by path i and back by path j (Lambertian,
// one emitter and receiver in one place):
//   w_ij = albedo dA (rho^n_i g_i cos_i / d_i^2) (rho^n_j g_j cos_j / d_j^2), range (d_i + d_j) / 2
// if 1 <= n_i + n_j <= order reflections; g is the one-way falloff. i, j and j, i are one echo of
// twice the amplitude, 4 w: behind one mirror the mean power over phases is 1 + 4 rho + rho^2, the
// mean of |1 + sqrt(rho) exp(i phi)|^4. The radar sends and receives at z > 0 only. With antennas
// the direction is the mean of both paths'.
void add_echoes_by_walls(const Scene& scene, const Conditions& conditions, const Gaze& gaze,
                         const Axis& x, const Axis& y, Returns& returns);

}  // namespace echofuse::sim
