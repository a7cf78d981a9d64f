// SPDX-License-Identifier: MIT
// Goes over a scene with rays, row by row. Internal to render.cpp.
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

// Points of the axis inside the interval, widened by the half step that a ray may be off and by
// rounding: [first, last).
inline std::pair<std::uint32_t, std::uint32_t> points_within(const Axis& axis, Interval t) {
  double a = (t.low - axis.start) / axis.step, b = (t.high - axis.start) / axis.step;
  if (a > b) std::swap(a, b);
  const double n = axis.count;
  return {static_cast<std::uint32_t>(std::clamp(std::floor(a - 0.5), 0.0, n)),
          static_cast<std::uint32_t>(std::clamp(std::ceil(b + 0.5) + 1, 0.0, n))};
}

// Steps that spread evenly over (-0.5, 0.5) for any run of k: multiples of the golden ratio.
inline double golden_offset(std::uint32_t k) {
  const double turns = (k + 0.5) * std::numbers::phi;
  return turns - std::floor(turns) - 0.5;
}

// How far each ray is off its point. Columns are counted from the middle and the two halves are
// mirror images, so that mirrored scenes meet mirrored rays.
struct Offsets {
  std::vector<double> dx_of_row, x_of_column, dy_of_column;
  std::vector<double> side_of_column;  // -1 left of the middle, 1 right of it

  Offsets(const Axis& x, const Axis& y, Sampling sampling)
      : dx_of_row(y.count), x_of_column(x.count), dy_of_column(x.count), side_of_column(x.count) {
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

// A shape and the points of the axes between which it can be met.
template <class Shape>
struct Placed {
  Shape shape;
  std::uint32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;

  Placed(const Shape& s, const Axis& x, const Axis& y) : shape(s) {
    std::tie(x0, x1) = points_within(x, shape.tangents_x());
    std::tie(y0, y1) = points_within(y, shape.tangents_y());
  }
  bool in_row(std::uint32_t iy) const { return iy >= y0 && iy < y1 && x0 < x1; }
};

inline constexpr std::int32_t nothing = -1;
// z infinite where there is nothing.
struct Image {
  std::vector<double> z, cosine, albedo;
};

// Rays from..to-1 of a row: (x, y, 1) met something at z, infinite where it did not.
struct Row {
  std::uint32_t iy, from, to;
  const double *x, *y, *z;
  const double *cosine, *albedo;  // for Shading::on
  const std::int32_t* shape;      // nothing: the room
};
enum class Shading : std::uint8_t { off, on };

// Goes through the image row by row, so that one row is all it holds. Shapes are numbered:
// capsules, then plates, then triangles.
class Scanner {
 public:
  Scanner(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y, Sampling sampling,
          RoomIs room = RoomIs::seen)
      : x_(x),
        y_(y),
        offsets_(x, y, sampling),
        ray_x_(x.count),
        ray_y_(x.count),
        met_(x.count),
        z_(x.count),
        cosine_(x.count),
        albedo_(x.count),
        shape_(x.count) {
    const Vec3 sensor{sensor_x_m, 0, 0};
    for (const auto& c : scene.capsules) capsules_.emplace_back(CapsuleShape(c, sensor), x, y);
    for (const auto& p : scene.plates) plates_.emplace_back(PlateShape(p, sensor), x, y);
    for (const auto& t : scene.triangles) triangles_.emplace_back(TriangleShape(t, sensor), x, y);
    std::sort(triangles_.begin(), triangles_.end(),
              [](const auto& a, const auto& b) { return a.y0 < b.y0; });
    if (scene.room && room == RoomIs::seen)
      background_ = room_image(*scene.room, sensor_x_m, x, y, sampling);
  }

  // visit(row) for every row in which something can be met.
  template <class Visit>
  void scan(Shading shading, Visit visit) {
    for (std::uint32_t iy = 0; iy < y_.count; ++iy) {
      find_extent(iy);
      if (from_ >= to_) continue;
      aim(iy);
      draw_row(iy);
      if (shading == Shading::on) shade_row();
      if (background_) add_background(iy);
      visit(Row{iy, from_, to_, ray_x_.data(), ray_y_.data(), z_.data(), cosine_.data(),
                albedo_.data(), shape_.data()});
    }
  }

  // Of what a ray met there, relative to the sensor: of unit length, towards the sensor.
  Vec3 normal(std::int32_t shape, Vec3 at) const;

  static std::shared_ptr<const Image> room_image(const Room& room, double sensor_x_m, const Axis& x,
                                                 const Axis& y, Sampling sampling);

 private:
  // use(shape, number) of every shape that reaches into the row.
  template <class Use>
  void for_each_in_row(std::uint32_t iy, Use use) const {
    std::int32_t number = 0;
    for (const auto& capsule : capsules_) {
      if (capsule.in_row(iy)) use(capsule, number);
      ++number;
    }
    for (const auto& plate : plates_) {
      if (plate.in_row(iy)) use(plate, number);
      ++number;
    }
    for (const auto& triangle : triangles_) {
      if (triangle.y0 > iy) break;
      if (triangle.in_row(iy)) use(triangle, number);
      ++number;
    }
  }

  void find_extent(std::uint32_t iy) {
    from_ = background_ ? 0 : x_.count;
    to_ = background_ ? x_.count : 0;
    for_each_in_row(iy, [&](const auto& placed, std::int32_t) {
      from_ = std::min(from_, placed.x0);
      to_ = std::max(to_, placed.x1);
    });
  }

  void aim(std::uint32_t iy) {
    const double dx = offsets_.dx_of_row[iy], y = y_.at(iy);
    for (std::uint32_t ix = from_; ix < to_; ++ix) {
      ray_x_[ix] = offsets_.x_of_column[ix] + dx * offsets_.side_of_column[ix];
      ray_y_[ix] = y + offsets_.dy_of_column[ix];
      z_[ix] = INFINITY;
      shape_[ix] = nothing;
    }
  }

  void draw_row(std::uint32_t iy) {
    for_each_in_row(iy, [&](const auto& placed, std::int32_t number) {
      const std::size_t first = placed.x0, count = placed.x1 - placed.x0;
      placed.shape.meet(&ray_x_[first], &ray_y_[first], met_.data(), count);
      keep_nearer(met_.data(), number, &z_[first], &shape_[first], count);
    });
  }

  void shade_row() {
    for (std::size_t first = from_, last = first; first < to_; first = last) {
      while (last < to_ && shape_[last] == shape_[first]) ++last;
      const auto shade = [&](const auto& shape) {
        shape.cosines(&ray_x_[first], &ray_y_[first], &z_[first], &cosine_[first], last - first);
        std::fill(&albedo_[first], &albedo_[first] + (last - first), shape.albedo);
      };
      auto number = static_cast<std::size_t>(shape_[first]);
      if (shape_[first] == nothing)
        std::fill(&cosine_[first], &cosine_[first] + (last - first), 0.0);
      else if (number < capsules_.size())
        shade(capsules_[number].shape);
      else if (number -= capsules_.size(); number < plates_.size())
        shade(plates_[number].shape);
      else
        shade(triangles_[number - plates_.size()].shape);
    }
  }

  void add_background(std::uint32_t iy) {
    const std::size_t row = std::size_t{iy} * x_.count;
    for (std::uint32_t ix = 0; ix < x_.count; ++ix)
      if (background_->z[row + ix] < z_[ix]) shape_[ix] = nothing;
    put_behind(&background_->z[row], &background_->cosine[row], &background_->albedo[row],
               z_.data(), cosine_.data(), albedo_.data(), x_.count);
  }

  const Axis& x_;
  const Axis& y_;
  Offsets offsets_;
  std::vector<double> ray_x_, ray_y_, met_, z_, cosine_, albedo_;  // of one row
  std::vector<std::int32_t> shape_;
  std::uint32_t from_ = 0, to_ = 0;  // where the row may hold something
  std::vector<Placed<CapsuleShape>> capsules_;
  std::vector<Placed<PlateShape>> plates_;
  std::vector<Placed<TriangleShape>> triangles_;
  std::shared_ptr<const Image> background_;
};

}  // namespace echofuse::sim
