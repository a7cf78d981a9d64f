// SPDX-License-Identifier: MIT
#include "acquire/measurement/depth_map.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::record {
namespace {

Axis pixel_axis(const char* name, std::uint32_t size, double half_tangent, double sign) {
  const double step = 2 * half_tangent / size;
  return tangent_axis(name, size, -sign * (half_tangent - step / 2), sign * step);
}

// Range [first, last) of the source pixels with centres inside a target pixel, or the nearest
// source pixel if no centre is inside.
struct PixelRange {
  std::uint32_t first, last;
};
std::vector<PixelRange> cells_of(const Axis& source, const Axis& target) {
  std::vector<PixelRange> cells(target.count);
  for (std::uint32_t i = 0; i < target.count; ++i) {
    const double a = (target.at(i - 0.5) - source.start) / source.step;
    const double b = (target.at(i + 0.5) - source.start) / source.step;
    const double centre = (target.at(i) - source.start) / source.step;
    const double n = source.count;
    // The range of a target pixel outside the source image stays empty.
    if (centre < -0.5 || centre > n - 0.5) continue;
    // The offset of 1e-9 assigns a centre that is exactly on an edge to only one target pixel.
    auto first = static_cast<std::int64_t>(std::clamp(std::ceil(std::min(a, b) - 1e-9), -1.0, n));
    auto last = static_cast<std::int64_t>(std::clamp(std::ceil(std::max(a, b) - 1e-9), -1.0, n));
    if (first >= last) first = std::lround(centre), last = first + 1;
    cells[i].first =
        static_cast<std::uint32_t>(std::clamp<std::int64_t>(first, 0, source.count - 1));
    cells[i].last = static_cast<std::uint32_t>(std::clamp<std::int64_t>(last, 1, source.count));
  }
  return cells;
}

}  // namespace

Axis MapGrid::x() const { return depth_x_axis(size, half_tangent); }
Axis MapGrid::y() const { return depth_y_axis(size, half_tangent); }

std::array<Axis, 3> MapGrid::axes() const {
  return {pixel_axis("map_x", size, half_tangent, 1),
          pixel_axis("map_y", size, half_tangent, -1),
          {"map_z", "depth", "m", 1, 0, far_m}};
}

std::array<Axis, 5> MapGrid::run_axes() const {
  const auto map = axes();
  return {x(), y(), map[0], map[1], map[2]};
}

std::string MapGrid::text() const {
  return format("%u x %u pixels, |x/z| up to %.4g, depth up to %.4g m", size, size, half_tangent,
                far_m);
}

bool MapGrid::operator==(const MapGrid& other) const {
  return size == other.size && std::abs(half_tangent - other.half_tangent) < 1e-3 * step() &&
         std::abs(far_m - other.far_m) < 1e-3 * far_m;
}

MapGrid map_grid_of(std::span<const Axis> axes) {
  const Axis *x = find_axis(axes, "map_x"), *y = find_axis(axes, "map_y"),
             *z = find_axis(axes, "map_z");
  MapGrid grid;
  if (x && x->count >= min_map_size && x->count <= max_map_size)
    grid.size = x->count, grid.half_tangent = x->step * x->count / 2;
  if (z) grid.far_m = z->step;
  const auto expected = grid.axes();
  if (grid.half_tangent >= min_map_half_tangent && grid.half_tangent <= max_map_half_tangent &&
      !x == !y && (!x || (same_axis(*x, expected[0]) && same_axis(*y, expected[1]))) &&
      grid.far_m >= min_map_far_m && grid.far_m <= max_map_far_m &&
      (!z || same_axis(*z, expected[2])))
    return grid;
  throw Error(ExitCode::failed,
              "axes map_x, map_y and map_z: expected 3 to 256 pixels per side, a maximum |x/z| "
              "from 0.02 to 3, and one depth bin that begins at 0 and ends between 0.1 and 65 m");
}

Axis depth_x_axis(std::uint32_t size, double half_tangent) {
  return pixel_axis("depth_x", size, half_tangent, 1);
}
Axis depth_y_axis(std::uint32_t size, double half_tangent) {
  return pixel_axis("depth_y", size, half_tangent, -1);
}

std::vector<float> to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
                             const MapGrid& target) {
  std::vector<float> out(target.pixels());
  to_target(depth_mm, x, y, target, out);
  return out;
}

void to_target(std::span<const std::uint16_t> depth_mm, const Axis& x, const Axis& y,
               const MapGrid& target, std::span<float> out) {
  const Axis target_x = target.x(), target_y = target.y();
  const auto limit_mm = static_cast<std::uint16_t>(std::lround(target.far_m * 1000));
  if (same_axis(x, target_x) && same_axis(y, target_y)) {
    // Selects the value before dividing, because a conditional division does not vectorise.
    std::transform(depth_mm.begin(), depth_mm.end(), out.begin(), [limit_mm](std::uint16_t mm) {
      return static_cast<float>(mm <= limit_mm ? mm : 0) / 1000.0f;
    });
    return;
  }
  const auto columns = cells_of(x, target_x);
  const auto rows = cells_of(y, target_y);
  std::vector<std::uint16_t> valid;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (std::size_t c = 0; c < columns.size(); ++c) {
      valid.clear();
      std::size_t seen = 0;
      for (std::uint32_t j = rows[r].first; j < rows[r].last; ++j) {
        for (std::uint32_t i = columns[c].first; i < columns[c].last; ++i, ++seen) {
          const std::uint16_t mm = depth_mm[std::size_t{j} * x.count + i];
          if (mm > 0 && mm <= limit_mm) valid.push_back(mm);
        }
      }
      if (valid.empty() || 2 * valid.size() < seen) continue;
      const auto middle = valid.begin() + static_cast<std::ptrdiff_t>(valid.size() / 2);
      std::nth_element(valid.begin(), middle, valid.end());
      out[r * columns.size() + c] = static_cast<float>(*middle) / 1000.0f;
    }
  }
}

}  // namespace echofuse::record
