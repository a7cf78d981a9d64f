// SPDX-License-Identifier: MIT
// From a camera's depth image to the 64 x 64 target, for real and simulated cameras alike.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::record {

inline constexpr std::uint32_t map_size = 64;
inline constexpr double map_half_tangent = 0.55;  // [S] field of view, both ways
inline constexpr double max_depth_m = 6.0;        // [S] depth span; beyond it: no return

// The axes of a depth map of `size` pixels over +-half_tangent, pixel centres inside the edges.
Axis depth_x_axis(std::uint32_t size = map_size, double half_tangent = map_half_tangent);
Axis depth_y_axis(std::uint32_t size = map_size, double half_tangent = map_half_tangent);

// z in metres on the target grid, row-major, 0 = no return. Each target pixel takes the median of
// the valid source pixels whose centres fall into it, and is "no return" unless at least half of
// them are valid; a source coarser than the target is sampled at the nearest pixel. Invalid source
// pixels (0) and those beyond max_depth_m never mix into a depth. Identity if the axes agree.
std::vector<float> to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
                             const Axis& target_x, const Axis& target_y);

}  // namespace echofuse::record
