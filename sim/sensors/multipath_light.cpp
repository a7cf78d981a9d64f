// SPDX-License-Identifier: MIT
#include "sim/sensors/multipath_light.hpp"

#include <cmath>

#include "acquire/record/depth_map.hpp"
#include "sim/sensors/gaze.hpp"
#include "sim/sensors/multipath_patches.hpp"

namespace echofuse::sim {
namespace {

using Patches = std::vector<Patch>;

struct Grid {
  Axis x, y;
  Grid(const Gaze& gaze, std::int64_t rays)
      : x(record::depth_x_axis(static_cast<std::uint32_t>(rays), gaze.half_tangent)),
        y(record::depth_y_axis(static_cast<std::uint32_t>(rays), gaze.half_tangent)) {
    x.start += gaze.middle_x, y.start += gaze.middle_y;
  }
};

// One way, of the falloff of both ways.
double dimming(const Gaze& gaze, const Patch& p) {
  if (gaze.falloff <= 0) return 1;
  const double dx = p.at.x / p.at.z - gaze.middle_x, dy = p.at.y / p.at.z - gaze.middle_y;
  return std::exp(-gaze.falloff * (dx * dx + dy * dy) /
                  (2 * gaze.half_tangent * gaze.half_tangent));
}

// Without those that a body hides.
Patches lit_walls(const Scene& scene, const Gaze& gaze, const Grid& grid) {
  Patches walls = patches_of(*scene.room, gaze.sensor_x_m, grid.x, grid.y);
  std::vector<double> body_m(std::size_t{grid.x.count} * grid.y.count, INFINITY);
  for (const Patch& p : patches_of(scene, gaze.sensor_x_m, grid.x, grid.y))
    body_m[p.ray] = p.range_m;
  std::erase_if(walls, [&](const Patch& p) { return body_m[p.ray] < p.range_m; });
  return walls;
}

void add(const Patches& walls, const Patches& seen, const Gaze& gaze, double ways, bool moves,
         Returns& out) {
  std::vector<double> irradiance;
  for (const Patch& p : walls)
    irradiance.push_back(p.albedo * dimming(gaze, p) * p.cosine / (p.range_m * p.range_m));
  for (std::size_t k = 0; k < seen.size(); ++k) {
    const Patch& patch = seen[k];
    const double seen_of_it =
        ways * patch.albedo * patch.solid_angle_sr * dimming(gaze, patch) / mean_scene_weight;
    const double extra_m = gaze.extra_m + (moves ? gaze.sway(k) : 0);
    for (std::size_t i = 0; i < walls.size(); ++i) {
      const double share = form_factor(patch, walls[i]);
      if (share <= 0) continue;
      const double way_m = walls[i].range_m + length(patch.at - walls[i].at) + patch.range_m;
      out.range_m.push_back(way_m / 2 + extra_m);
      out.weight.push_back(seen_of_it * irradiance[i] * share);
    }
  }
}

}  // namespace

void add_light_by_walls(const Scene& scene, const Gaze& gaze, RoomIs room, Returns& returns,
                        const PatchRays& rays) {
  if (!scene.room) return;
  const Grid wall(gaze, rays.wall), body(gaze, rays.body);
  const Patches bodies = patches_of(scene, gaze.sensor_x_m, body.x, body.y);
  if (!bodies.empty()) add(lit_walls(scene, gaze, wall), bodies, gaze, 2, true, returns);
  if (room == RoomIs::subtracted) return;
  const Patches walls = patches_of(*scene.room, gaze.sensor_x_m, wall.x, wall.y);
  add(walls, walls, gaze, 1, false, returns);
}

}  // namespace echofuse::sim
