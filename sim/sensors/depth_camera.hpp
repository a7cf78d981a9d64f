// SPDX-License-Identifier: MIT
// This file turns exact depths into those that a depth camera gives.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// It adds range noise to a frame of exact z (mm, row-major, 0: no return): sigma = depth_noise_m
// z^2 for z in metres, as for a camera that triangulates. At edges it loses the share depth_dropout
// of the pixels. A pixel is at an edge if a neighbour above, below or beside it has no return or is
// more than 0.1 m away. It also makes holes, a constant offset, and steps of depth_step_m z^2.
void disturb_depth(std::vector<std::uint16_t>& mm, std::uint32_t width,
                   const Conditions& conditions, Rng& rng);

// Depth image of a record, on this grid. It is exact, or, if anything disturbs, it is
// made by the product from a disturbed frame of 320 x 240 pixels, the simulated camera's. What is
// beyond the grid's range stays: readers leave it out.
std::vector<std::uint16_t> depth_map_mm(const Scene& scene, record::MapGrid grid,
                                        const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim
