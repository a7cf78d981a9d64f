// SPDX-License-Identifier: MIT
// Scans a scene with rays, row by row. Internal to the files in sim/sensors.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "drivers/core/axis.hpp"
#include "sim/scene/shapes.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// indices [first, last) of the points of an axis
using PointRange = std::pair<std::uint32_t, std::uint32_t>;

// Converts an interval of tangents to point indices, widened by half a step for staggered rays.
inline Interval in_points(const Axis& axis, Interval t) {
  const double a = (t.low - axis.start) / axis.step, b = (t.high - axis.start) / axis.step;
  return {std::min(a, b) - 0.5, std::max(a, b) + 0.5};
}

// Returns the points of the axis with rays inside the interval. Rounding may add a neighbouring
// point.
inline PointRange points_within(const Axis& axis, Interval t) {
  const auto [low, high] = in_points(axis, t);
  const double n = axis.count;
  return {static_cast<std::uint32_t>(std::clamp(std::floor(low), 0.0, n)),
          static_cast<std::uint32_t>(std::clamp(std::ceil(high) + 1, 0.0, n))};
}

// Returns offset number k in (-0.5, 0.5), computed from a multiple of the golden ratio. Successive
// offsets are evenly distributed.
inline double golden_offset(std::uint32_t k) {
  const double turns = (k + 0.5) * std::numbers::phi;
  return turns - std::floor(turns) - 0.5;
}

// Offset of each ray from its point. The offsets in the left and right half are mirror images, so
// that mirrored scenes yield mirrored results.
struct Offsets {
  std::vector<double> dx_of_row, x_of_column, dy_of_column;
  std::vector<double>
      side_of_column;  // -1 left of the middle column, 0 in this column, 1 right of it

  Offsets(const Axis& x, const Axis& y, Sampling sampling)
      : dx_of_row(y.count),
        x_of_column(x.count + spare_rays),
        dy_of_column(x_of_column.size()),
        side_of_column(x_of_column.size()) {
    const bool staggered = sampling == Sampling::staggered;
    for (std::uint32_t iy = 0; staggered && iy < y.count; ++iy)
      dx_of_row[iy] = x.step * golden_offset(iy);
    for (std::uint32_t ix = 0; ix < x.count; ++ix) {
      const std::uint32_t mirror = x.count - 1 - ix;
      x_of_column[ix] = x.at(ix);
      side_of_column[ix] = ix < mirror ? -1 : ix > mirror ? 1 : 0;
      if (staggered) dy_of_column[ix] = y.step * golden_offset(std::min(ix, mirror));
    }
  }
};

// Shape with the columns [x0, x1) and rows [y0, y1) of the rays that can meet it.
template <class Shape>
struct Placed {
  Shape shape;
  std::uint32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;

  Placed(const Shape& s, const Axis& x, const Axis& y) : shape(s) {
    std::tie(x0, x1) = points_within(x, shape.tangents_x());
    std::tie(y0, y1) = points_within(y, shape.tangents_y());
  }
  // Returns the columns of rays in row iy that can meet the shape.
  PointRange columns(std::uint32_t) const { return {x0, x1}; }
};

// A tilted limb fills only a small part of its bounding box. Its bounds in a row are therefore
// interpolated between the bounds a and b of both ends: (1 - t) a + t b. The row determines the
// range of t.
template <>
struct Placed<CapsuleShape> {
  CapsuleShape shape;
  std::uint32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;

  Placed(const CapsuleShape& s, const Axis& x, const Axis& y) : shape(s) {
    const auto [a, b] = s.ends();
    std::tie(x0, x1) = points_within(x, hull(a.x, b.x));
    std::tie(y0, y1) = points_within(y, hull(a.y, b.y));
    constexpr double more = 1e-6;  // margin for rounding errors
    const Interval ax = in_points(x, a.x), bx = in_points(x, b.x);
    const Interval ay = in_points(y, a.y), by = in_points(y, b.y);
    left_ = {ax.low - more, bx.low - more}, right_ = {ax.high + more, bx.high + more};
    top_ = {ay.low - more, by.low - more}, bottom_ = {-ay.high - more, -by.high - more};
    for (const Bound& e : {left_, right_, top_, bottom_}) bounded_ &= std::isfinite(e.a + e.by);
  }
  PointRange columns(std::uint32_t iy) const {
    if (!bounded_ || x1 - x0 < worth_it) return {x0, x1};
    double from = 0, to = 1;
    const auto y = static_cast<double>(iy);
    top_.keep_below(y, from, to), bottom_.keep_below(-y, from, to);
    if (from > to) return {0, 0};
    // Rounds down to a column, after clipping the value to the columns of the shape.
    const auto cut = [&](double point) {
      return static_cast<std::uint32_t>(std::clamp<double>(point, x0, x1));
    };
    return {cut(std::min(left_.at(from), left_.at(to))),
            cut(std::max(right_.at(from), right_.at(to)) + 2)};
  }

 private:
  // Bound that changes linearly from end a (t = 0) to end b (t = 1).
  struct Bound {
    Bound(double of_a, double of_b) : a(of_a), by(of_b - of_a), per(by == 0 ? 0 : 1 / by) {}
    double at(double t) const { return a + t * by; }
    // Limits [from, to] to the values of t for which the bound is at most y.
    void keep_below(double y, double& from, double& to) const {
      const double t = (y - a) * per;
      if (by > 0) to = std::min(to, t);
      if (by < 0) from = std::max(from, t);
      if (by == 0 && a > y) to = -1;
    }
    double a, by, per;
  };
  // bounds in points of the axes; bottom_ has the opposite sign
  Bound left_{0, 0}, right_{0, 0}, top_{0, 0}, bottom_{0, 0};
  // Minimum width, in points, for which the interpolation saves time.
  static constexpr std::uint32_t worth_it = 16;
  bool bounded_ = true;
};

inline constexpr std::int32_t nothing = -1;
// Rendered image: arrays [y][x], padded to a SIMD width. z is infinite where a ray hits no surface.
struct Image {
  std::vector<double> z, cosine, albedo;
};

// Rays [from, to) of a row, with directions (x, y, 1), and the surfaces hit by these rays. z is
// infinite where a ray hits no surface. Arrays are padded to a SIMD width.
struct ScanRow {
  std::uint32_t iy, from, to;
  const double *x, *y, *z;
  const double *cosine, *albedo;  // only for Shading::on
  const std::int32_t* shape;      // shape number; -1: the room
  // Runs of neighbouring rays that hit a surface; only for Shading::on.
  const std::vector<PointRange>& met;
};
// Calls use(first, last) for each maximal run of neighbours in [from, to) that all satisfy keep(i).
template <class Keep, class Use>
void for_each_run(std::size_t from, std::size_t to, Keep keep, Use use) {
  for (std::size_t first = from, last = from; first < to; first = last) {
    while (first < to && !keep(first)) ++first;
    for (last = first; last < to && keep(last);) ++last;
    if (first < last) use(first, last);
  }
}
enum class Shading : std::uint8_t { off, on };

// Renders an image row by row and keeps only the current row. Shapes are numbered in the order
// capsules, plates, triangles.
class Scanner {
 public:
  Scanner(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y, Sampling sampling,
          RoomReturns room = RoomReturns::included)
      : x_(x),
        y_(y),
        offsets_(x, y, sampling),
        ray_x_(x.count + spare_rays),
        ray_y_(ray_x_.size()),
        met_(ray_x_.size()),
        z_(ray_x_.size()),
        cosine_(ray_x_.size()),
        albedo_(ray_x_.size()),
        shape_(ray_x_.size()) {
    const Vec3 sensor{sensor_x_m, 0, 0};
    for (const auto& c : scene.capsules) capsules_.emplace_back(CapsuleShape(c, sensor), x, y);
    for (const auto& p : scene.plates) plates_.emplace_back(PlateShape(p, sensor), x, y);
    for (const auto& t : scene.triangles) triangles_.emplace_back(TriangleShape(t, sensor), x, y);
    std::sort(triangles_.begin(), triangles_.end(),
              [](const auto& a, const auto& b) { return a.y0 < b.y0; });
    if (scene.room && room == RoomReturns::included)
      background_ = room_image(*scene.room, sensor_x_m, x, y, sampling);
  }

  // Calls visit(row) for every row in which a ray may hit a shape or the room.
  template <class Visit>
  void scan(Shading shading, Visit visit) {
    const auto [first, last] = rows();
    for (std::uint32_t iy = first; iy < last; ++iy) {
      find_shapes(iy);
      if (from_ >= to_) continue;
      aim_row(iy);
      draw_row();
      to_ = std::min(to_, x_.count);  // excludes the padding
      if (shading == Shading::on) shade_row();
      if (background_) add_background(iy);
      visit(ScanRow{iy, from_, to_, ray_x_.data(), ray_y_.data(), z_.data(), cosine_.data(),
                    albedo_.data(), shape_.data(), runs_});
    }
  }

  // Returns the unit normal of the shape at this point, facing the sensor.
  Vec3 normal(std::int32_t shape, Vec3 at) const;

  static std::shared_ptr<const Image> room_image(const Room& room, double sensor_x_m, const Axis& x,
                                                 const Axis& y, Sampling sampling);

 private:
  // Returns the rows in which a ray may hit a shape or the room.
  PointRange rows() const {
    if (background_) return {0, y_.count};
    PointRange out{y_.count, 0};
    const auto add = [&](const auto& shapes) {
      for (const auto& s : shapes) out = {std::min(out.first, s.y0), std::max(out.second, s.y1)};
    };
    add(capsules_), add(plates_), add(triangles_);
    return out;
  }

  // Collects the shapes that rays of row iy may hit, with their columns.
  void find_shapes(std::uint32_t iy) {
    from_ = background_ ? 0 : x_.count;
    to_ = background_ ? x_.count : 0;
    in_row_.clear();
    const auto render_shape = [&](const auto& placed, std::int32_t number) {
      if (iy < placed.y0 || iy >= placed.y1) return;
      const auto [first, last] = placed.columns(iy);
      if (first >= last) return;
      const std::uint32_t end = first + static_cast<std::uint32_t>(whole_steps(last - first));
      in_row_.push_back({number, first, end});
      from_ = std::min(from_, first);
      to_ = std::max(to_, end);
    };
    std::int32_t number = 0;
    for (const auto& capsule : capsules_) render_shape(capsule, number++);
    for (const auto& plate : plates_) render_shape(plate, number++);
    for (const auto& triangle : triangles_) {
      if (triangle.y0 > iy) break;
      render_shape(triangle, number++);
    }
  }

  // Calls use(shape) for the shape with this number.
  template <class Use>
  void with_shape(std::int32_t shape, Use use) const {
    auto number = static_cast<std::size_t>(shape);
    if (number < capsules_.size()) return use(capsules_[number].shape);
    if (number -= capsules_.size(); number < plates_.size()) return use(plates_[number].shape);
    use(triangles_[number - plates_.size()].shape);
  }

  void aim_row(std::uint32_t iy) {
    aim(&offsets_.x_of_column[from_], &offsets_.side_of_column[from_],
        &offsets_.dy_of_column[from_], offsets_.dx_of_row[iy], y_.at(iy), &ray_x_[from_],
        &ray_y_[from_], &z_[from_], &shape_[from_], whole_steps(to_ - from_));
  }

  void draw_row() {
    for (const InRow& in : in_row_)
      with_shape(in.number, [&](const auto& shape) {
        shape.meet(&ray_x_[in.first], &ray_y_[in.first], met_.data(), in.last - in.first);
        keep_nearer(met_.data(), in.number, &z_[in.first], &shape_[in.first], in.last - in.first);
      });
  }

  void shade_row() {
    runs_.clear();
    for (std::size_t first = from_, last = first; first < to_; first = last) {
      while (last < to_ && shape_[last] == shape_[first]) ++last;
      if (shape_[first] == nothing) {
        std::fill(&cosine_[first], &cosine_[first] + (last - first), 0.0);
        continue;
      }
      if (runs_.empty() || runs_.back().second != first)
        runs_.emplace_back(static_cast<std::uint32_t>(first), 0);
      runs_.back().second = static_cast<std::uint32_t>(last);
      with_shape(shape_[first], [&](const auto& shape) {
        shape.cosines(&ray_x_[first], &ray_y_[first], &z_[first], &cosine_[first],
                      whole_steps(last - first));
        std::fill(&albedo_[first], &albedo_[first] + (last - first), shape.albedo);
      });
    }
  }

  void add_background(std::uint32_t iy) {
    const std::size_t row = std::size_t{iy} * x_.count;
    for (std::uint32_t ix = 0; ix < x_.count; ++ix)
      if (background_->z[row + ix] < z_[ix]) shape_[ix] = nothing;
    put_behind(&background_->z[row], &background_->cosine[row], &background_->albedo[row],
               z_.data(), cosine_.data(), albedo_.data(), x_.count);
    runs_.clear();
    for_each_run(
        0, x_.count, [&](std::size_t i) { return z_[i] < INFINITY; },
        [&](std::size_t first, std::size_t last) {
          runs_.emplace_back(static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last));
        });
  }

  struct InRow {
    std::int32_t number;
    std::uint32_t first, last;
  };

  const Axis& x_;
  const Axis& y_;
  Offsets offsets_;
  // Values of the current row, padded to a SIMD width.
  std::vector<double> ray_x_, ray_y_, met_, z_, cosine_, albedo_;
  std::vector<std::int32_t> shape_;
  std::vector<InRow> in_row_;
  std::vector<PointRange> runs_;
  std::uint32_t from_ = 0, to_ = 0;  // columns of the current row in which a ray may hit a surface
  std::vector<Placed<CapsuleShape>> capsules_;
  std::vector<Placed<PlateShape>> plates_;
  std::vector<Placed<TriangleShape>> triangles_;
  std::shared_ptr<const Image> background_;
};

}  // namespace echofuse::sim
