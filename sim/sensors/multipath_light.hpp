// SPDX-License-Identifier: MIT
// Light reflected by Lambertian walls: laser - wall - body - detector, and the reverse path.
#pragma once
#include <cstdint>

#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Gaze;

// Number of rays across the field of view, in x and in y. Each ray defines a patch of a wall or of
// a body.
struct PatchRays {
  std::int64_t wall = 24, body = 40;
};

// Adds the returns of light with 1 to `order` reflections at the room (walls, floor, ceiling,
// boxes) and one at a body. Uses the radiosity method, bounce by bounce (Goral et al., SIGGRAPH
// 1984). The laser and the detector have the same position and field of view. Therefore both
// directions of a path return equal light, and all surfaces must be in the field of view.
// Wall patch p receives e_p = cos_p / R_p^2. With form factors F (form_factor()), body patch k
// receives
//   E_k  = sum_p albedo_p F_kp e_p                       by one wall reflection,
//   E'_k = sum_q albedo_q F_kq sum_p albedo_p F_qp e_p   by two wall reflections.
// It returns the weights
//   1: w = 2 albedo_k dOmega_k E_k, range (R_p + |p - k| + R_k) / 2
//   2: w = 2 albedo_k dOmega_k E'_k + albedo_k dA_k E_k^2, path lengths in steps of 5 cm
// Bodies shade the walls behind them. RoomReturns::included also adds light between walls, as in
// the empty room. The simulation ignores obstacles between p and k, light between bodies, and light
// from shaded walls that are lit by other walls.
void add_light_by_walls(const Scene& scene, const Gaze& gaze, std::int64_t order, RoomReturns room,
                        Returns& returns, const PatchRays& rays = {});

}  // namespace echofuse::sim
