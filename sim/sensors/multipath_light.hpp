// SPDX-License-Identifier: MIT
// Light by Lambertian walls: laser - wall - body - detector, and the reverse path.
#pragma once
#include <cstdint>

#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Gaze;

// Rays across the field of view, horizontally and vertically, that sample the patches.
struct PatchRays {
  std::int64_t wall = 24, body = 40;
};

// Adds the returns with 1 to `order` reflections by the room (walls, floor, ceiling, boxes) in
// addition to the body's. Laser and detector share place and field of view. So both directions are
// equal and all surfaces must be in the field of view (radiosity, bounce by bounce; Goral et al.,
// SIGGRAPH 1984). Let e_p = cos_p / R_p^2 on wall patch p, and F the form factor of
// multipath_patches.hpp. Body patch k receives E_k = sum_p albedo_p F_kp e_p by one wall and E'_k =
// sum_q albedo_q F_kq sum_p albedo_p F_qp e_p by two, and returns
//   1: w = 2 albedo_k dOmega_k E_k           range (R_p + |p - k| + R_k) / 2
//   2: w = 2 albedo_k dOmega_k E'_k + albedo_k dA_k E_k^2, path lengths in steps of 5 cm
// Bodies shade the walls behind them. RoomReturns::included includes light between walls, as in the
// empty room. Left out: obstacles between p and k, light between bodies, and light from bodies to
// walls that another wall lights.
void add_light_by_walls(const Scene& scene, const Gaze& gaze, std::int64_t order, RoomReturns room,
                        Returns& returns, const PatchRays& rays = {});

}  // namespace echofuse::sim
