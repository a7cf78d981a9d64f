// SPDX-License-Identifier: MIT
// Light that comes by a wall, Lambertian: laser - wall - body - detector, and the same way back.
#pragma once
#include <cstdint>

#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Gaze;

// Rays across the field of view whose patches exchange light.
struct PatchRays {
  std::int64_t wall = 40, body = 64;  // both ways
};

// Adds the returns of one reflection by the room (walls, floor, ceiling, boxes) beside the body's.
// Laser and detector are in one place and have one field of view, so wall and body have to be in
// it, and both ways round are alike (radiosity of one bounce; Goral et al., SIGGRAPH 1984):
//   w = 2 sum_p albedo_k dOmega_k * (albedo_p cos_p / R_p^2) F_kp,   range (R_p + |p - k| + R_k) /
//   2
// with E = cos_p / R_p^2 on wall patch p and F_kp of multipath_patches.hpp. Bodies take light from
// the walls behind them. RoomIs::seen: with what walls send each other, as if nobody was there.
// Left out: what stands between p and k; light from body to body.
void add_light_by_walls(const Scene& scene, const Gaze& gaze, RoomIs room, Returns& returns,
                        const PatchRays& rays = {});

}  // namespace echofuse::sim
