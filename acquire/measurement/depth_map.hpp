// SPDX-License-Identifier: MIT
// Projects a camera's depth image onto a run's depth map; the same for real and simulated cameras.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::record {

// 2^23, the limit of one bridge frame.
inline constexpr std::uint64_t max_depth_pixels = std::uint64_t{1} << 23;

// Grid of a run's depth maps: size x size pixels over tangents of +-half_tangent in both
// directions, and depths up to far_m. A run states its grid as axes map_x, map_y and map_z (one bin
// from 0); without them these defaults apply.
struct MapGrid {
  std::uint32_t size = 64;
  double half_tangent = 0.55;  // field of view
  double far_m = 6;            // farther points are no return

  std::size_t pixels() const { return std::size_t{size} * size; }
  double step() const { return 2 * half_tangent / size; }  // tangent
  Axis x() const;                                          // same as depth_x_axis
  Axis y() const;
  std::array<Axis, 3> axes() const;      // map_x, map_y, map_z
  std::array<Axis, 5> run_axes() const;  // axes of a run with depth images already on this grid
  std::string text() const;              // "64 x 64 over tangents of +-0.55, up to 6 m"
  // Tolerance: a thousandth of a pixel, and of the range.
  bool operator==(const MapGrid& other) const;
};
inline constexpr std::uint32_t least_map_size = 3, most_map_size = 256;
inline constexpr double least_map_half_tangent = 0.02, most_map_half_tangent = 3;
inline constexpr double least_map_far_m = 0.1, most_map_far_m = 65;  // depth images end at 65.5 m

// Reads the grid from a run's axes. Throws Error(failed) if map_x, map_y and map_z are not a valid
// grid.
MapGrid map_grid_of(std::span<const Axis> axes);

// Returns the axes of a depth map of `size` pixels over +-half_tangent, with pixel centres inside
// the edges.
Axis depth_x_axis(std::uint32_t size, double half_tangent);
Axis depth_y_axis(std::uint32_t size, double half_tangent);

// Returns z in metres on the target grid, row-major, 0 = no return. A target pixel is the median of
// the valid source pixels with centres inside it. It is "no return" unless at least half of them
// are valid. A source coarser than the target is sampled at the nearest pixel. Invalid source
// pixels (0) and pixels beyond target.far_m never contribute to a depth. Identity if the axes
// agree.
std::vector<float> to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
                             const MapGrid& target);
// Fills `out`, which must have target.pixels() zeros.
void to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
               const MapGrid& target, std::span<float> out);

}  // namespace echofuse::record
