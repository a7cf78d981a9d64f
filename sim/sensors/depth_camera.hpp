// SPDX-License-Identifier: MIT
// Adds the errors of a depth camera to exact depths.
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
// z^2. Drops the share depth_dropout of edge pixels: those with a neighbour above, below, left or
// right that has no return or differs by more than 0.1 m.
void disturb_depth(std::vector<std::uint16_t>& mm, std::uint32_t width,
                   const Conditions& conditions, Rng& rng);

// Returns the depth image of a record on this grid: exact, or, with any camera error set, resampled
// by the product's code from a frame of 320 x 240 pixels with errors. Depths beyond the grid's
// range are kept; readers drop them.
std::vector<std::uint16_t> depth_map_mm(const Scene& scene, record::MapGrid grid,
                                        const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim
