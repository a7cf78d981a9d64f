// SPDX-License-Identifier: MIT
// The surface that a depth map shows, as patches: what the sensors should have seen.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "acquire/record/depth_map.hpp"

namespace echofuse::sim {

// Parts that may be of different brightness: of the body's height above 0.87 and below 0.5.
enum class Zone : std::uint8_t { torso, legs, head, plate };
inline constexpr int zones = 4;

struct SurfacePatch {
  double x = 0, y = 0, z = 0;  // m
  double weight = 0;           // cos(theta) dOmega, both as seen from the origin
  Zone zone = Zone::torso;
};

struct Surface {
  std::vector<SurfacePatch> patches;
  // In metres. Centroid and rms width of the silhouette, its area, its ends.
  double x = 0, z = 0, width = 0, area = 0, top = 0, foot = 0;
  double roughness = 0;  // mean |second difference| of z along rows, where it is below 10 cm
  double holes = 0;      // share of pixels without return between two with
  double plate_area = 0, plate_gap = 0,
         plate_drop = 0;  // of the letter: before the body, below top

  double tangent() const { return z > 0 ? x / z : 0; }
};

// Each pixel becomes 4 x 4 patches of the plane through it and its neighbours on the same surface.
// Pixels farther than `empty` (that map without people; none: an open room) less 10 cm are the
// room's. With `letter` what is before the greatest gap in depth is the plate. No patches: nobody.
Surface surface_of(std::span<const std::uint16_t> depth_mm, std::span<const std::uint16_t> empty_mm,
                   const record::MapGrid& grid, bool letter);

}  // namespace echofuse::sim
