// SPDX-License-Identifier: MIT
#include "recon/models/body/body_frame.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "recon/maps/scene.hpp"
#include "recon/numbers/matrix_file.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t most_side = record::most_map_size, most_cells = most_side * 3 / 2;

// Where a coordinate lies among n points: between `low` and the next one, by `part`.
struct Between {
  std::ptrdiff_t low = 0;
  float part = 0;
};

// What is no number, or too far to count, is outside.
Between between(double at) {
  if (!(std::abs(at) < 1e9)) return {-2, 0};
  const double low = std::floor(at);
  return {static_cast<std::ptrdiff_t>(low), static_cast<float>(at - low)};
}

float pixel(std::span<const float> row, std::ptrdiff_t i) {
  return i >= 0 && i < std::ssize(row) ? row[static_cast<std::size_t>(i)] : 0.f;
}

float sample(std::span<const float> row, const Between& b) {
  return (1 - b.part) * pixel(row, b.low) + b.part * pixel(row, b.low + 1);
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
  const std::size_t most = std::size_t{grid.size} * 3 / 2;
  pitch_m_ = x.step * depth;  // the map's, where bodies stand: a finer one gains nothing
  const auto cells = [&](double extent) {
    return std::clamp<std::size_t>(static_cast<std::size_t>(extent / pitch_m_) + 2, 2, most);
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
  for (std::size_t r = 0; r < rows_; ++r) {
    const Between v =
        between(((top_m_ + static_cast<double>(r) * pitch_m_) / z - y.start) / y.step);
    for (std::size_t c = 0; c < columns_; ++c) {
      const double across = (left_m_ + static_cast<double>(c) * pitch_m_) / z;
      const Between u = between((double{place.tangent} + across - x.start) / x.step);
      const auto value = [&](const auto& image) {
        return (1 - v.part) * sample(row_of(image, v.low), u) +
               v.part * sample(row_of(image, v.low + 1), u);
      };
      mask[r * columns_ + c] = value(body);
      relief[r * columns_ + c] = value(depth);
    }
  }
}

template <class Paint>
void BodyFrame::visit(std::span<const float> mask, std::span<const float> relief,
                      const Place& place, float least, const Paint& paint) const {
  const Axis x = grid_.x(), y = grid_.y();
  const std::size_t side = grid_.size;
  const double z = double{place.depth_m};
  std::array<Between, most_side> across;
  std::array<float, most_cells> most{};  // of a column
  for (std::size_t r = 0; r < rows_; ++r)
    for (std::size_t c = 0; c < columns_; ++c) most[c] = std::max(most[c], mask[r * columns_ + c]);
  std::size_t first = side, last = 0;  // map columns with something to paint: [first, last)
  for (std::size_t c = 0; c < side; ++c) {
    const double at = (x.at(static_cast<double>(c)) - double{place.tangent}) * z;
    across[c] = between((at - left_m_) / pitch_m_);
    if (across[c].low < 0 || across[c].low + 1 >= static_cast<std::ptrdiff_t>(columns_)) continue;
    const auto low = static_cast<std::size_t>(across[c].low);
    if (std::max(most[low], most[low + 1]) <= least) continue;
    first = std::min(first, c), last = c + 1;
  }
  std::array<float, most_cells> body{}, depth{};
  for (std::size_t r = 0; r < side; ++r) {
    const Between v = between((y.at(static_cast<double>(r)) * z - top_m_) / pitch_m_);
    if (v.low < 0 || v.low + 1 >= static_cast<std::ptrdiff_t>(rows_)) continue;
    const std::size_t upper = static_cast<std::size_t>(v.low) * columns_, lower = upper + columns_;
    for (std::size_t c = 0; c < columns_; ++c) {
      body[c] = mask[upper + c] + v.part * (mask[lower + c] - mask[upper + c]);
      depth[c] = relief[upper + c] + v.part * (relief[lower + c] - relief[upper + c]);
    }
    for (std::size_t c = first; c < last; ++c) {
      const auto low = static_cast<std::size_t>(across[c].low);
      const float share = body[low] + across[c].part * (body[low + 1] - body[low]);
      paint(r * side + c, share, depth[low] + across[c].part * (depth[low + 1] - depth[low]));
    }
  }
}

void BodyFrame::draw(std::span<const float> mask, std::span<const float> relief, const Place& place,
                     float threshold, std::span<const float> background,
                     std::span<float> map) const {
  std::copy(background.begin(), background.end(), map.begin());
  visit(mask, relief, place, threshold, [&](std::size_t pixel, float share, float offset) {
    if (share > threshold) map[pixel] = place.depth_m + offset / share;
  });
}

void BodyFrame::draw_soft(std::span<const float> mask, std::span<const float> relief,
                          const Place& place, std::span<float> share,
                          std::span<float> depth) const {
  constexpr float least_share = 0.1f;  // below, relief / mask is noise
  std::fill(share.begin(), share.end(), 0.f);
  std::fill(depth.begin(), depth.end(), place.depth_m);
  visit(mask, relief, place, -1, [&](std::size_t pixel, float part, float offset) {
    share[pixel] = std::clamp(part, 0.f, 1.f);
    if (part > least_share) depth[pixel] = place.depth_m + offset / part;
  });
}

std::size_t BodyFrame::draw_cost() const {
  const std::size_t side = grid_.size;
  return side * (2 * columns_ + 2 * std::min(side, columns_));
}

void BodyFrame::save(record::H5File& file) const {
  file.make_group("model/frame");
  file.set("model/frame", "columns", static_cast<std::int64_t>(columns_));
  file.set("model/frame", "rows", static_cast<std::int64_t>(rows_));
  file.set("model/frame", "left_m", left_m_);
  file.set("model/frame", "top_m", top_m_);
  file.set("model/frame", "pitch_m", pitch_m_);
}

void BodyFrame::load(const record::H5File& file) {
  grid_ = load_grid(file);
  const std::size_t most = std::size_t{grid_.size} * 3 / 2;
  const auto cells = [&](const char* attribute) {
    const auto count = file.get<std::int64_t>("model/frame", attribute);
    require_sound(file, count >= 2 && std::cmp_less_equal(count, most),
                  std::string("model/frame@") + attribute, "2 to " + std::to_string(most));
    return static_cast<std::size_t>(count);
  };
  columns_ = cells("columns"), rows_ = cells("rows");
  left_m_ = file.get<double>("model/frame", "left_m");
  top_m_ = file.get<double>("model/frame", "top_m");
  pitch_m_ = file.get<double>("model/frame", "pitch_m");
  require_sound(file, pitch_m_ > 0, "model/frame@pitch_m", "more than 0");
}

}  // namespace echofuse::recon
