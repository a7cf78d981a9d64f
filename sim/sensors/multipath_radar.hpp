// SPDX-License-Identifier: MIT
// Echoes of radar or sound that are reflected by specular walls. Uses the image-source method
// (Allen and Berkley, J. Acoust. Soc. Am. 65, 943, 1979).
#pragma once
#include <array>
#include <optional>
#include <vector>

#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Gaze;

// Mirror image of a sensor after a reflection at one wall or at two walls.
struct ImageSource {
  Vec3 at;
  std::array<const Plate*, 2> walls{};  // reflecting walls, in the order of the outgoing path
  int reflections = 0;                  // number of reflections; 0: the sensor itself
};
// Returns the sensor and its mirror images with at most `order` reflections (0 to 2). Only the
// first Room::walls plates of the room reflect.
std::vector<ImageSource> image_sources(const Room& room, Vec3 sensor, int order);

struct Way {
  Vec3 departure;  // unit vector along the path at the sensor
  Vec3 arrival;    // unit vector along the path at its end
  double length_m = 0;
};
// Returns the path from the sensor to the point `place` via the reflections of `image`; empty if a
// reflection point is outside its wall. Ignores obstacles.
std::optional<Way> way_to(const ImageSource& image, Vec3 sensor, Vec3 place);

// Adds the echoes of patches visible to the radar that travel out on path i and back on path j,
// with 1 <= n_i + n_j <= multipath_order reflections. Patches are Lambertian. The emitter and the
// receiver are at the same position.
//   w_ij = albedo dA (rho^n_i g_i cos_i / d_i^2) (rho^n_j g_j cos_j / d_j^2), range (d_i + d_j) / 2
// A path has the length d, the angle of incidence with cosine cos, and the one-way falloff g; rho
// is radar_wall_reflectivity. If i and j differ, the path and the reverse path add up to twice the
// amplitude, so the weight is 4 w_ij. Behind one mirror the power relative to the direct echo is
// the mean of |1 + sqrt(rho) exp(i phi)|^4 over all phases phi: 1 + 4 rho + rho^2. The radar sends
// and receives only at z > 0. If Returns::place is filled, the direction of an echo is the mean
// direction of both paths.
void add_echoes_by_walls(const Scene& scene, const Conditions& conditions, const Gaze& gaze,
                         const Axis& x, const Axis& y, Returns& returns);

}  // namespace echofuse::sim
