// SPDX-License-Identifier: MIT
// Resamples a camera's depth image to the grid of a run's depth maps, for real and simulated
// cameras.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::record {

// Maximum number of pixels of a depth image; a frame of the bridge protocol cannot hold more.
inline constexpr std::uint64_t max_depth_pixels = std::uint64_t{1} << 23;

// Grid of the depth maps of a run: `size` x `size` pixels, which cover tangents from
// -`half_tangent` to +`half_tangent` in both directions, and depths from 0 to `far_m`. A run stores
// its grid as the axes `map_x`, `map_y` and `map_z` (one bin that starts at 0). The defaults apply
// if a run does not have these axes.
struct MapGrid {
  std::uint32_t size = 64;
  double half_tangent = 0.55;  // tangent of half the field of view
  double far_m = 6;            // largest depth; farther points count as "no return"

  std::size_t pixels() const { return std::size_t{size} * size; }
  double step() const { return 2 * half_tangent / size; }  // tangent
  Axis x() const;                                          // Returns depth_x_axis() for this grid.
  Axis y() const;
  std::array<Axis, 3> axes() const;      // {map_x, map_y, map_z}
  std::array<Axis, 5> run_axes() const;  // axes of a run that stores depth images on this grid
  std::string text() const;              // e.g. "64 x 64 pixels, |x/z| up to 0.55, depth up to 6 m"
  // Tolerates differences of 0.001 pixel in `half_tangent` and of 0.1 % in `far_m`.
  bool operator==(const MapGrid& other) const;
};
inline constexpr std::uint32_t min_map_size = 3, max_map_size = 256;
inline constexpr double min_map_half_tangent = 0.02, max_map_half_tangent = 3;
// Depth images store depths as u16 millimetres, so depths above 65.5 m cannot be stored.
inline constexpr double min_map_far_m = 0.1, max_map_far_m = 65;

// Reads the grid from a run's axes. Throws Error(failed) if the axes `map_x`, `map_y` and `map_z`
// are not a valid grid.
MapGrid map_grid_of(std::span<const Axis> axes);

// Returns an axis of a depth map with `size` pixels, which cover tangents from -`half_tangent` to
// +`half_tangent`. The outermost pixel centres are half a pixel inside these limits.
Axis depth_x_axis(std::uint32_t size, double half_tangent);
Axis depth_y_axis(std::uint32_t size, double half_tangent);

// Resamples a depth image to the target grid. Returns z in metres, row-major; 0 means "no return".
// The depth of a target pixel is the median of the valid source pixels with centres inside it, or
// "no return" if fewer than half of them are valid. If the source is coarser than the target, the
// nearest source pixel is used. Source pixels that are 0 or exceed `target.far_m` are not valid. If
// the source and target grids are the same, the pixels are copied.
std::vector<float> to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
                             const MapGrid& target);
// Like to_target() above, but writes the depths into `out`, which must contain target.pixels()
// zeros.
void to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
               const MapGrid& target, std::span<float> out);

}  // namespace echofuse::record
