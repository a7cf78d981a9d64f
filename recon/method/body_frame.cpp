// SPDX-License-Identifier: MIT
#include "recon/method/body_frame.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include "drivers/core/clones.hpp"
#include "recon/metrics/scene_model.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t max_side = record::max_map_size, max_cells = max_side * 3 / 2;

// Positions of the points of one grid relative to the cells of another grid, along one dimension.
// Point i lies between cells low[i] and low[i] + 1, at the fraction part[i].
struct CellInterpolation {
  std::array<std::int32_t, max_cells> low;
  std::array<float, max_cells> part;
};

// Sets the position of point i to first + i * step. A position that is not finite or too far away
// is marked as outside: low < 0.
ECHOFUSE_CLONES void place_along(double first, double step, std::size_t count,
                                 CellInterpolation& out) {
  for (std::size_t i = 0; i < count; ++i) {
    const double at = first + static_cast<double>(static_cast<std::int32_t>(i)) * step;
    const double near = std::abs(at) < 1e9 ? at : -2, low = std::floor(near);
    out.low[i] = static_cast<std::int32_t>(low), out.part[i] = static_cast<float>(near - low);
  }
}

float pixel(std::span<const float> row, std::ptrdiff_t i) {
  return i >= 0 && i < std::ssize(row) ? row[static_cast<std::size_t>(i)] : 0.f;
}

float sample(std::span<const float> row, std::ptrdiff_t low, float part) {
  return (1 - part) * pixel(row, low) + part * pixel(row, low + 1);
}

}  // namespace

std::optional<Place> place_of(std::span<const float> map, std::span<const float> background,
                              const record::MapGrid& grid) {
  const Axis x = grid.x();
  double tangent = 0, depth = 0, pixels = 0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (!true_foreground(map[p], background[p])) continue;
    tangent += x.at(static_cast<double>(p % grid.size)), depth += double{map[p]}, ++pixels;
  }
  if (pixels == 0) return std::nullopt;
  return Place{static_cast<float>(tangent / pixels), static_cast<float>(depth / pixels)};
}

BodyFrame::BodyFrame(const Matrix& maps, std::span<const float> background, const Rows& rows,
                     const std::vector<Place>& places, const record::MapGrid& grid)
    : grid_(grid) {
  const Axis x = grid.x(), y = grid.y();
  double right = 0, bottom = -1e9, depth = 0;
  left_m_ = 0, top_m_ = 1e9;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto map = maps.row(rows[i]);
    const double z = double{places[i].depth_m};
    depth += z / static_cast<double>(rows.size());
    for (std::size_t p = 0; p < map.size(); ++p) {
      if (!true_foreground(map[p], background[p])) continue;
      const double across =
          (x.at(static_cast<double>(p % grid.size)) - double{places[i].tangent}) * z;
      const double down = y.at(static_cast<double>(p / grid.size)) * z;
      left_m_ = std::min(left_m_, across), right = std::max(right, across);
      top_m_ = std::min(top_m_, down), bottom = std::max(bottom, down);
    }
  }
  const std::size_t max_extent = std::size_t{grid.size} * 3 / 2;
  // Pixel pitch at the mean depth of the bodies; a finer pitch adds no detail.
  pitch_m_ = x.step * depth;
  const auto cells = [&](double extent) {
    return std::clamp<std::size_t>(static_cast<std::size_t>(extent / pitch_m_) + 2, 2, max_extent);
  };
  columns_ = cells(right - left_m_), rows_ = cells(bottom - top_m_);
}

void BodyFrame::cut(std::span<const float> map, std::span<const float> background,
                    const Place& place, std::span<float> mask, std::span<float> relief) const {
  const Axis x = grid_.x(), y = grid_.y();
  const std::size_t side = grid_.size;
  const double z = double{place.depth_m};
  std::vector<float> body(map.size()), depth(map.size());
  for (std::size_t p = 0; p < map.size(); ++p)
    if (true_foreground(map[p], background[p])) body[p] = 1, depth[p] = map[p] - place.depth_m;
  const auto row_of = [&](const auto& image, std::ptrdiff_t r) {
    return r >= 0 && r < static_cast<std::ptrdiff_t>(side)
               ? std::span<const float>(image).subspan(static_cast<std::size_t>(r) * side, side)
               : std::span<const float>{};
  };
  CellInterpolation across, down;
  place_along((double{place.tangent} + left_m_ / z - x.start) / x.step, pitch_m_ / z / x.step,
              columns_, across);
  place_along((top_m_ / z - y.start) / y.step, pitch_m_ / z / y.step, rows_, down);
  for (std::size_t r = 0; r < rows_; ++r)
    for (std::size_t c = 0; c < columns_; ++c) {
      const auto value = [&](const auto& image) {
        const auto of = [&](std::ptrdiff_t row) {
          return sample(row_of(image, row), across.low[c], across.part[c]);
        };
        return (1 - down.part[r]) * of(down.low[r]) + down.part[r] * of(down.low[r] + 1);
      };
      mask[r * columns_ + c] = value(body);
      relief[r * columns_ + c] = value(depth);
    }
}

namespace {

// Pixels [first, last) along one side of the map.
struct Span {
  std::size_t first, last;
};

// Returns the range of points that lie between the centres of the first and the last cell. `cells`:
// number of cells.
Span within(const CellInterpolation& along, std::size_t points, std::size_t cells) {
  Span out{points, 0};
  for (std::size_t i = 0; i < points; ++i)
    if (along.low[i] >= 0 && std::cmp_less(along.low[i] + 1, cells))
      out.first = std::min(out.first, i), out.last = i + 1;
  return out;
}

struct Drawing {
  const float *mask, *relief;  // mask and relief of each cell
  std::size_t columns, side;   // number of cell columns, and side length of the map in pixels
  CellInterpolation across, down;
  Span map_columns, map_rows;
  float depth_m, threshold;
};

// Writes the depth of the body to each pixel with a mask above `threshold`. If `share` is not null,
// also writes the mask of each pixel to `share`.
ECHOFUSE_CLONES void draw_rows(const Drawing& d, float* map, float* share) {
  const std::size_t first = d.map_columns.first, count = d.map_columns.last - first;
  const std::int32_t* const low = &d.across.low[first];
  const float* const part = &d.across.part[first];
  const std::int32_t nearest = low[0];  // first cell column that the row needs
  const auto cells = static_cast<std::size_t>(low[count - 1] + 2 - nearest);
  // For each cell, the first pixel at or after it.
  std::array<std::size_t, max_cells + 1> from;
  std::size_t cell = 0;
  for (std::size_t c = 0; c < count; ++c)
    while (cell <= static_cast<std::size_t>(low[c] - nearest)) from[cell++] = c;
  while (cell <= cells) from[cell++] = count;
  std::array<float, max_cells> mask_row, relief_row;
  for (std::size_t r = d.map_rows.first; r < d.map_rows.last; ++r) {
    const std::size_t upper =
        static_cast<std::size_t>(d.down.low[r]) * d.columns + static_cast<std::size_t>(nearest);
    const float *mask_above = d.mask + upper, *mask_below = mask_above + d.columns;
    const float *relief_above = d.relief + upper, *relief_below = relief_above + d.columns;
    const float down = d.down.part[r];
    for (std::size_t c = 0; c < cells; ++c) {
      mask_row[c] = mask_above[c] + down * (mask_below[c] - mask_above[c]);
      relief_row[c] = relief_above[c] + down * (relief_below[c] - relief_above[c]);
    }
    std::size_t begin = 0, end = count;
    if (!share) {  // restricts the row to pixels near cells above the threshold
      std::size_t some = 0, last = cells;
      while (some < cells && mask_row[some] <= d.threshold) ++some;
      while (last > some && mask_row[last - 1] <= d.threshold) --last;
      if (some == last) continue;
      begin = some > 0 ? from[some - 1] : 0, end = from[last];
    }
    const std::size_t start = r * d.side + first;
    for (std::size_t c = begin; c < end; ++c) {
      const std::int32_t at = low[c] - nearest;
      const float *masks = &mask_row[0] + at, *reliefs = &relief_row[0] + at;
      const float body = masks[0] + part[c] * (masks[1] - masks[0]);
      const float ahead = reliefs[0] + part[c] * (reliefs[1] - reliefs[0]);
      const bool seen = body > d.threshold;
      const float depth = d.depth_m + ahead / (seen ? body : 1.f);
      map[start + c] = seen ? depth : map[start + c];
      if (share) share[start + c] = std::clamp(body, 0.f, 1.f);
    }
  }
}

}  // namespace

void BodyFrame::draw_onto(std::span<const float> mask, std::span<const float> relief,
                          const Place& place, float threshold, std::span<float> map,
                          std::span<float> share) const {
  const Axis x = grid_.x(), y = grid_.y();
  const std::size_t side = grid_.size;
  const double z = double{place.depth_m}, cells_a_tangent = z / pitch_m_;
  Drawing d;
  d.mask = mask.data(), d.relief = relief.data(), d.columns = columns_, d.side = side;
  d.depth_m = place.depth_m, d.threshold = threshold;
  place_along((x.start - double{place.tangent}) * cells_a_tangent - left_m_ / pitch_m_,
              x.step * cells_a_tangent, side, d.across);
  place_along(y.start * cells_a_tangent - top_m_ / pitch_m_, y.step * cells_a_tangent, side,
              d.down);
  d.map_columns = within(d.across, side, columns_), d.map_rows = within(d.down, side, rows_);
  if (d.map_columns.first >= d.map_columns.last) return;
  draw_rows(d, map.data(), share.empty() ? nullptr : share.data());
}

void BodyFrame::draw(std::span<const float> mask, std::span<const float> relief, const Place& place,
                     float threshold, std::span<float> map) const {
  draw_onto(mask, relief, place, threshold, map, {});
}

void BodyFrame::draw_soft(std::span<const float> mask, std::span<const float> relief,
                          const Place& place, std::span<float> share,
                          std::span<float> depth) const {
  constexpr float min_share = 0.1f;  // below this mask value, relief / mask is mostly noise
  std::fill(share.begin(), share.end(), 0.f);
  std::fill(depth.begin(), depth.end(), place.depth_m);
  draw_onto(mask, relief, place, min_share, depth, share);
}

std::size_t BodyFrame::draw_cost() const {
  const std::size_t side = grid_.size;
  return side * (2 * columns_ + 2 * std::min(side, columns_));
}

void BodyFrame::archive(Archive archive, const record::MapGrid& grid) {
  grid_ = grid;
  const std::int64_t max_extent = std::int64_t{grid_.size} * 3 / 2;
  archive.count("columns", columns_, 2, max_extent);
  archive.count("rows", rows_, 2, max_extent);
  archive.number("left_m", left_m_, -100, 100);
  archive.number("top_m", top_m_, -100, 100);
  archive.number("pitch_m", pitch_m_, 1e-6, 100);
}

}  // namespace echofuse::recon
