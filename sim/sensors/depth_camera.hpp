// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Adds the errors of a triangulating depth camera to a frame of exact depths z (mm, row-major; 0:
// no return). Each depth gets Gaussian noise of rms `depth_noise_m` z^2 (z in m) and the constant
// `depth_offset_m`. Edge pixels lose their return with the probability `depth_dropout`. An edge
// pixel has a neighbour (left, right, above or below) without a return, or with a depth that
// differs by more than 0.1 m.
void disturb_depth(std::vector<std::uint16_t>& mm, std::uint32_t width,
                   const Conditions& conditions, Rng& rng);

// Returns the depth map of a record on this grid, mm. If all camera errors are 0, the map is exact.
// Otherwise a frame of 320 x 240 pixels with errors is resampled as in recorded runs
// (record::to_target()). Depths beyond the range of the grid are kept; readers discard them.
std::vector<std::uint16_t> depth_map_mm(const Scene& scene, record::MapGrid grid,
                                        const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim
