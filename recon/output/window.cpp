// SPDX-License-Identifier: MIT
#include "recon/output/window.hpp"

#include <algorithm>
#include <cmath>

namespace echofuse::recon {
namespace {

constexpr double least_depth_m = 0.1;

// Indices of the map's points nearest to the window's; those outside are out of range.
std::vector<std::ptrdiff_t> nearest(const Axis& map, const Axis& window) {
  std::vector<std::ptrdiff_t> out;
  for (std::uint32_t i = 0; i < window.count; ++i)
    out.push_back(std::lround((window.at(i) - map.start) / map.step));
  return out;
}

}  // namespace

Window window_about_body(std::span<const float> map, const Scene& scene, double size_m) {
  const Axis x = scene.grid.x(), y = scene.grid.y();
  const auto share = foreground_share(map, scene);
  double right = 0, up = 0, depth = 0, pixels = 0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (!(share[p] > 0.5f)) continue;
    right += x.at(static_cast<double>(p % x.count)), up += y.at(static_cast<double>(p / x.count));
    depth += double{map[p]}, ++pixels;
  }
  if (pixels > 0)
    right /= pixels, up /= pixels, depth /= pixels;
  else
    depth = double{scene.foreground_depth_m};
  const double step = size_m / std::max(depth, least_depth_m) / x.count;
  const double half = step * (x.count - 1) / 2;
  Window out{x, y};
  out.x.start = right - half, out.x.step = step;
  out.y.start = up + half, out.y.step = -step;
  return out;
}

std::vector<float> cut(std::span<const float> map, const record::MapGrid& grid,
                       const Window& window) {
  const auto columns = nearest(grid.x(), window.x), rows = nearest(grid.y(), window.y);
  const auto size = static_cast<std::ptrdiff_t>(grid.size);
  std::vector<float> out;
  for (const std::ptrdiff_t row : rows)
    for (const std::ptrdiff_t column : columns) {
      const bool inside = row >= 0 && row < size && column >= 0 && column < size;
      out.push_back(inside ? map[static_cast<std::size_t>(row * size + column)] : 0.f);
    }
  return out;
}

}  // namespace echofuse::recon
