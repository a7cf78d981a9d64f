// SPDX-License-Identifier: MIT
// Light also comes by a Lambertian wall: laser - wall - body - detector, and the same way back.
#pragma once
#include <cstdint>

#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Gaze;

// Rays across the field of view, both ways, whose patches exchange light.
struct PatchRays {
  std::int64_t wall = 24, body = 40;
};

// Adds the returns of 1 to `order` reflections by the room (walls, floor, ceiling, boxes) beside
// the body's. Laser and detector are in one place and have one field of view, so all surfaces have
// to be in it, and both ways round are alike (radiosity, bounce by bounce; Goral et al., SIGGRAPH
// 1984). Let e_p = cos_p / R_p^2 on wall patch p, and F be that of multipath_patches.hpp. Then body
// patch k gets E_k = sum_p albedo_p F_kp e_p by one wall and E'_k = sum_q albedo_q F_kq sum_p
// albedo_p F_qp e_p by two, and sends back
//   1: w = 2 albedo_k dOmega_k E_k           range (R_p + |p - k| + R_k) / 2
//   2: w = 2 albedo_k dOmega_k E'_k + albedo_k dA_k E_k^2, ways in steps of 5 cm
// Bodies shade the walls behind them. RoomIs::seen includes what walls send each other, as if
// nobody was there. Left out are obstacles between p and k, light from body to body, and light from
// bodies to walls that another wall lights.
void add_light_by_walls(const Scene& scene, const Gaze& gaze, std::int64_t order, RoomIs room,
                        Returns& returns, const PatchRays& rays = {});

}  // namespace echofuse::sim
