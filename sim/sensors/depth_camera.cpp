// SPDX-License-Identifier: MIT
#include "sim/sensors/depth_camera.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>

#include "acquire/measurement/depth_map.hpp"
#include "sim/scene/draw.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {
namespace {

constexpr int edge_mm = 100;

bool at_edge(const std::vector<std::uint16_t>& mm, std::size_t width, std::size_t i) {
  const auto differs = [&](std::size_t j) {
    return mm[j] == 0 || std::abs(int{mm[i]} - int{mm[j]}) > edge_mm;
  };
  const std::size_t column = i % width;
  return (column > 0 && differs(i - 1)) || (column + 1 < width && differs(i + 1)) ||
         (i >= width && differs(i - width)) || (i + width < mm.size() && differs(i + width));
}

bool disturbs(const Conditions& c) {
  return c.depth_noise_m > 0 || c.depth_dropout > 0 || c.depth_offset_m != 0;
}

}  // namespace

void disturb_depth(std::vector<std::uint16_t>& mm, std::uint32_t width, const Conditions& c,
                   Rng& rng) {
  if (c.depth_dropout > 0) {
    const std::vector<std::uint16_t> exact = mm;
    for (std::size_t i = 0; i < mm.size(); ++i)
      if (exact[i] > 0 && at_edge(exact, width, i) && uniform(rng, 0, 1) < c.depth_dropout)
        mm[i] = 0;
  }
  if (c.depth_noise_m <= 0 && c.depth_offset_m == 0) return;
  std::normal_distribution<double> noise;
  for (auto& pixel : mm) {
    if (pixel == 0) continue;
    const double z_m = pixel / 1000.0;
    double seen_mm = pixel + 1000 * c.depth_offset_m;
    if (c.depth_noise_m > 0) seen_mm += 1000 * c.depth_noise_m * z_m * z_m * noise(rng);
    pixel = static_cast<std::uint16_t>(std::clamp(std::round(seen_mm), 1.0, 65535.0));
  }
}

std::vector<std::uint16_t> depth_map_mm(const Scene& scene, record::MapGrid grid,
                                        const Conditions& c, Rng& rng) {
  if (!disturbs(c)) return render_depth_mm(scene, grid.x(), grid.y());
  constexpr std::uint32_t width = 320, height = 240;
  const Axis columns = record::depth_x_axis(width, c.half_tangent * 16 / 11);
  const Axis rows = record::depth_y_axis(height, c.half_tangent * 12 / 11);
  auto frame = render_depth_mm(scene, columns, rows);
  disturb_depth(frame, width, c, rng);
  grid.far_m = record::max_map_far_m;
  const auto map = record::to_target(frame, columns, rows, grid);
  std::vector<std::uint16_t> mm(map.size());
  std::transform(map.begin(), map.end(), mm.begin(),
                 [](float z_m) { return static_cast<std::uint16_t>(std::lround(1000 * z_m)); });
  return mm;
}

}  // namespace echofuse::sim
