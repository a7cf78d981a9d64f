// SPDX-License-Identifier: MIT
// Turns exact depths into those of a depth camera.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Adds a triangulating camera's errors to a frame of exact z (mm, row-major, 0: no return): noise
// of sigma = depth_noise_m z^2 (z in metres), holes, a constant offset, and steps of depth_step_m
// z^2. Drops the share depth_dropout of the pixels at edges: those with a neighbour above, below or
// beside that has no return or is more than 0.1 m away.
void disturb_depth(std::vector<std::uint16_t>& mm, std::uint32_t width,
                   const Conditions& conditions, Rng& rng);

// Depth image of a record, on this grid. It is exact, or, if anything disturbs, it is
// made by the product from a disturbed frame of 320 x 240 pixels, the simulated camera's. What is
// beyond the grid's range stays: readers leave it out.
std::vector<std::uint16_t> depth_map_mm(const Scene& scene, record::MapGrid grid,
                                        const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim
