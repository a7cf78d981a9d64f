// SPDX-License-Identifier: MIT
// Renders a scene by casting rays at capsules, plates and triangles, without tessellation.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// First surface hit by a ray. If the ray hits no surface, `range_m` is 0.
struct Hit {
  float range_m = 0;  // slant range from the sensor, m
  float z_m = 0;
  float cos_theta = 0;  // cosine of the angle between the surface normal and the ray, >= 0
  float albedo = 0;
};

// Position of each ray in its pixel. Staggered rays have a different offset from the pixel centre
// in each row and column. The area of a shape with edges along the grid (upright letters) is
// therefore correct on average. Rays at the pixel centres may count a whole row too many or too
// few.
enum class Sampling : std::uint8_t { centres, staggered };

// Casts one ray for each pair of points of the axes, which are the tangents x/z and y/z of the ray.
// The result is row-major, [y][x]. The sensor is at (sensor_x_m, 0, 0) and looks along +z.
std::vector<Hit> cast(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y,
                      Sampling sampling = Sampling::centres);

// Returns the depth z of each pixel in mm, row-major, for a camera at the origin; 0 if no surface
// lies within 65.535 m.
std::vector<std::uint16_t> render_depth_mm(const Scene& scene, const Axis& x, const Axis& y);

// Surface patches visible to one sensor. The weight of a patch is albedo cos(theta) dOmega / R^2
// (Lambertian surface; the source and the receiver are at the same position), divided by
// mean_scene_weight. The weights of an average scene under the default conditions therefore add up
// to 1.
struct Returns {
  std::vector<double> range_m;
  std::vector<double> weight;
  // Tangents of the direction of each patch; only for a detector with zones.
  std::vector<float> tangent_x{}, tangent_y{};
  // Direction cosines x/R and y/R of a patch, its height above the floor, and its owner: a person
  // (0, 1, ...) or one of the negative constants below. Returns of the radar have these values if
  // `radar_antennas` > 0 or `radar_sum` is coherent.
  struct PatchOrigin {
    float x = 0, y = 0, height_m = 0;
    std::int32_t person = still;
  };
  static constexpr std::int32_t still = -1;  // owner: the room or an object
  static constexpr std::int32_t reflector = -2, leakage = -3;
  std::vector<PatchOrigin> place{};
};

// Returns the owner of shape `number` (see Scanner) for PatchOrigin::person. Each person consists
// of `capsules_of_person` successive capsules. Plates belong to person 0 or, if the scene contains
// no people, to the reflector.
std::int32_t person_of(const Scene& scene, std::int32_t number);

// Sum of albedo cos(theta) dOmega / R^2, averaged over scenes under the default conditions (one
// person for every three letters). It equals the value of a white plate of A = 0.24 m^2 at R = 3.5
// m: A / R^4. It is a constant, so the sum of the weights of a scene depends on the distance, the
// size and the albedo of its targets.
inline constexpr double mean_scene_weight = 0.24 / (3.5 * 3.5 * 3.5 * 3.5);

// Return the patches visible to the detector or the radar, each with its own occlusion. Ranges
// include `spd_delay_ps` or `radar_bias_m`. The patches are followed by the returns reflected by
// walls (multipath_order; range: half of the path length) and by the leakage of the radar.
// RoomReturns::subtracted omits the visible patches of the room and includes its hidden patches
// with negative weights. Quantities that are linear in the weights are then changes relative to the
// empty room.
enum class RoomReturns : std::uint8_t { included, subtracted };
Returns spd_returns(const Scene& scene, const Conditions& conditions);
Returns radar_returns(const Scene& scene, const Conditions& conditions);
// Overloads that write the patches to `out`. Reuse `out` for each scene, because allocating new
// memory takes as long as rendering.
void spd_returns(const Scene& scene, const Conditions& conditions, Returns& out,
                 RoomReturns room = RoomReturns::included);
void radar_returns(const Scene& scene, const Conditions& conditions, Returns& out,
                   RoomReturns room = RoomReturns::included);

}  // namespace echofuse::sim
