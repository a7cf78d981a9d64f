// SPDX-License-Identifier: MIT
// Casts rays at capsules, plates and triangles, without tessellation.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// First surface that a ray hits; range 0: none.
struct Hit {
  float range_m = 0;  // slant range from the sensor
  float z_m = 0;
  float cos_theta = 0;  // between the surface normal and the ray, >= 0
  float albedo = 0;
};

// Position of a ray in its pixel. Staggered rays are off the pixel centre by a different step in
// each row and column. So edges along the grid (letters held upright) are counted correctly on
// average, instead of one row too many or too few.
enum class Sampling : std::uint8_t { centres, staggered };

// Casts one ray per point of the axes (values: x/z and y/z of the ray); row-major, y
// outermost. The sensor at (x, 0, 0) looks along +z.
std::vector<Hit> cast(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y,
                      Sampling sampling = Sampling::centres);

// Returns z in millimetres as seen from the origin, row-major; 0: nothing within 65.535 m.
std::vector<std::uint16_t> render_depth_mm(const Scene& scene, const Axis& x, const Axis& y);

// Surface patches visible to one sensor. weight = albedo cos(theta) dOmega / R^2 (source and
// receiver in one place, Lambertian), in units of the mean scene's: the weights of an average scene
// of the base condition sum to 1.
struct Returns {
  std::vector<double> range_m;
  std::vector<double> weight;
  std::vector<float> tangent_x{}, tangent_y{};  // directions; only for a detector with zones
  // The radar's returns have places if it has antennas (radar_antennas > 0) or its echoes
  // interfere. A place has the direction cosines x/R and y/R, the height above the floor, and the
  // owner of the patch: person 0, 1..., or something that stands still.
  struct PatchOrigin {
    float x = 0, y = 0, height_m = 0;
    std::int32_t person = still;
  };
  static constexpr std::int32_t still = -1;  // the room, an object
  static constexpr std::int32_t reflector = -2, leakage = -3;
  std::vector<PatchOrigin> place{};
};

// Returns the index of the person that shape `number` of a scene (scanner.hpp) belongs to. Person i
// is the i-th group of capsules; plates belong to the people who hold them.
std::int32_t person_of(const Scene& scene, std::int32_t number);

// Sum of albedo cos(theta) dOmega / R^2 over the mean scene (1000 people to 3000 letters of the
// base condition). Equals that of a calibration target, a white plate of 0.24 m^2 at 3.5 m: A /
// R^4. A constant, so that nearer, larger or darker targets keep their own brightness.
inline constexpr double mean_scene_weight = 0.24 / (3.5 * 3.5 * 3.5 * 3.5);

// Returns the patches visible from the origin and from the radar's place, each with its own
// occlusion. Ranges include spd_delay_ps and radar_bias_m. Returns by walls follow
// (multipath_order; range: half of the path), then the radar's leakage. RoomReturns::subtracted
// leaves out the room, except patches hidden by others, which get negative weights. Any quantity
// linear in the weights is then the change relative to the empty room.
enum class RoomReturns : std::uint8_t { included, subtracted };
Returns spd_returns(const Scene& scene, const Conditions& conditions);
Returns radar_returns(const Scene& scene, const Conditions& conditions);
// Same, reusing the memory of an earlier scene, because allocation takes as long as rendering.
void spd_returns(const Scene& scene, const Conditions& conditions, Returns& out,
                 RoomReturns room = RoomReturns::included);
void radar_returns(const Scene& scene, const Conditions& conditions, Returns& out,
                   RoomReturns room = RoomReturns::included);

}  // namespace echofuse::sim
