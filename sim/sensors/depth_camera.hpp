// SPDX-License-Identifier: MIT
// What a depth camera makes of the exact depths.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Adds to a frame of exact z (mm, row-major, 0: no return) range noise, sigma = depth_noise_m z^2
// for z in metres as of a camera that triangulates, and loses at edges the share depth_dropout of
// the pixels: at an edge is who has a neighbour above, below or beside without return or more than
// 0.1 m away. Also holes, a constant offset, and steps of depth_step_m z^2.
void disturb_depth(std::vector<std::uint16_t>& mm, std::uint32_t width,
                   const Conditions& conditions, Rng& rng);

// The map of a record: exact, or what the product makes of a disturbed frame of 320 x 240 pixels,
// the simulated camera's, if anything disturbs.
std::vector<std::uint16_t> depth_map_mm(const Scene& scene, const Axis& x, const Axis& y,
                                        const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim
