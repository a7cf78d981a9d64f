// SPDX-License-Identifier: MIT
// From a camera's depth image to a run's depth map, for real and simulated cameras alike.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::record {

// 2^23: as many fit into one frame of a bridge.
inline constexpr std::uint64_t max_depth_pixels = std::uint64_t{1} << 23;

// Grid of a run's depth maps: size x size pixels over tangents of +-half_tangent, both ways, and
// depths up to far_m. A run states its own as axes map_x, map_y and map_z (one bin from 0 on);
// without them it has this default.
struct MapGrid {
  std::uint32_t size = 64;
  double half_tangent = 0.55;  // [S] field of view
  double far_m = 6;            // [S] what is farther is no return

  std::size_t pixels() const { return std::size_t{size} * size; }
  double step() const { return 2 * half_tangent / size; }  // tangent
  Axis x() const;                                          // as depth_x_axis
  Axis y() const;
  std::array<Axis, 3> axes() const;      // map_x, map_y, map_z
  std::array<Axis, 5> run_axes() const;  // axes of a run whose depth images are such maps already
  std::string text() const;              // "64 x 64 over tangents of +-0.55, up to 6 m"
  // To a thousandth of a pixel, and of the range.
  bool operator==(const MapGrid& other) const;
};
inline constexpr std::uint32_t least_map_size = 16, most_map_size = 256;
inline constexpr double least_map_half_tangent = 0.02, most_map_half_tangent = 3;
inline constexpr double least_map_far_m = 0.1, most_map_far_m = 65;  // depth images end at 65.5 m

// Reads the grid from a run's axes. Throws Error(failed) if map_x, map_y and map_z are no such
// grid.
MapGrid map_grid_of(std::span<const Axis> axes);

// The axes of a depth map of `size` pixels over +-half_tangent, pixel centres inside the edges.
Axis depth_x_axis(std::uint32_t size, double half_tangent);
Axis depth_y_axis(std::uint32_t size, double half_tangent);

// z in metres on the target grid, row-major, 0 = no return. Each target pixel takes the median of
// the valid source pixels whose centres fall into it, and is "no return" unless at least half of
// them are valid; a source coarser than the target is sampled at the nearest pixel. Invalid source
// pixels (0) and those beyond target.far_m never mix into a depth. Identity if the axes agree.
std::vector<float> to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
                             const MapGrid& target);
// Fills `out`, target.pixels() zeros.
void to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
               const MapGrid& target, std::span<float> out);

}  // namespace echofuse::record
