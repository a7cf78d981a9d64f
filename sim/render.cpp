// SPDX-License-Identifier: MIT
#include "sim/render.hpp"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <tuple>
#include <utility>

#include "acquire/record/depth_map.hpp"
#include "sim/capsule.hpp"
#include "sim/room.hpp"

namespace echofuse::sim {
namespace {

// Whatever reaches nearer to the sensor's plane is tested against every ray.
constexpr double near_m = 0.05;

struct Interval {
  double low, high;
};
Interval hull(Interval a, Interval b) { return {std::min(a.low, b.low), std::max(a.high, b.high)}; }
constexpr Interval everything{-INFINITY, INFINITY};

// The tangents under which a disc of this radius at (s, z) appears in its plane: the exact
// silhouette of a sphere along one axis.
Interval disc_tangents(double s, double z, double radius) {
  if (z - radius < near_m) return everything;
  const double middle = std::atan2(s, z);
  const double half = std::asin(radius / std::hypot(s, z));
  return {std::tan(middle - half), std::tan(middle + half)};
}

// Points of the axis inside the interval, widened by the half step that a ray may be off and by
// rounding: [first, last).
std::pair<std::uint32_t, std::uint32_t> points_within(const Axis& axis, Interval t) {
  double a = (t.low - axis.start) / axis.step, b = (t.high - axis.start) / axis.step;
  if (a > b) std::swap(a, b);
  const double n = axis.count;
  return {static_cast<std::uint32_t>(std::clamp(std::floor(a - 0.5), 0.0, n)),
          static_cast<std::uint32_t>(std::clamp(std::ceil(b + 0.5) + 1, 0.0, n))};
}

// Steps that spread evenly over (-0.5, 0.5) for any run of k: multiples of the golden ratio.
double golden_offset(std::uint32_t k) {
  const double turns = (k + 0.5) * std::numbers::phi;
  return turns - std::floor(turns) - 0.5;
}

// How far each ray is off its point. Columns are counted from the middle and the two halves are
// mirror images, so that mirrored scenes meet mirrored rays.
struct Offsets {
  std::vector<double> dx_of_row, dy_of_column;

  Offsets(const Axis& x, const Axis& y, Sampling sampling)
      : dx_of_row(y.count), dy_of_column(x.count) {
    if (sampling == Sampling::centres) return;
    for (std::uint32_t iy = 0; iy < y.count; ++iy) dx_of_row[iy] = x.step * golden_offset(iy);
    for (std::uint32_t ix = 0; ix < x.count; ++ix)
      dy_of_column[ix] = y.step * golden_offset(std::min(ix, x.count - 1 - ix));
  }
};

Interval tangents_x(const CapsuleShape& c) {
  return hull(disc_tangents(c.a.x, c.a.z, c.radius), disc_tangents(c.b.x, c.b.z, c.radius));
}
Interval tangents_y(const CapsuleShape& c) {
  return hull(disc_tangents(c.a.y, c.a.z, c.radius), disc_tangents(c.b.y, c.b.z, c.radius));
}

struct PlateShape {
  struct Band {
    double u, v, eu, ev, length, half_width;
  };
  Vec3 centre, u, v, n;
  double albedo, distance;
  std::vector<Band> bands;
  Interval u_range{INFINITY, -INFINITY}, v_range{INFINITY, -INFINITY};

  PlateShape(const Plate& p, Vec3 sensor)
      : centre(p.centre - sensor),
        u(p.u),
        v(p.v),
        n(cross(u, v)),
        albedo(p.albedo),
        distance(dot(n, centre)) {
    for (const auto& s : p.strokes) {
      const double du = s.u1 - s.u0, dv = s.v1 - s.v0, reach = std::hypot(du, dv);
      const double half = s.width_m / 2;
      bands.push_back({s.u0, s.v0, du / reach, dv / reach, reach, half});
      u_range = hull(u_range, {std::min(s.u0, s.u1) - half, std::max(s.u0, s.u1) + half});
      v_range = hull(v_range, {std::min(s.v0, s.v1) - half, std::max(s.v0, s.v1) + half});
    }
  }
  template <class Coordinate>
  Interval tangents(Coordinate of) const {
    Interval all{INFINITY, -INFINITY};
    for (const double pu : {u_range.low, u_range.high})
      for (const double pv : {v_range.low, v_range.high}) {
        const Vec3 corner = centre + pu * u + pv * v;
        if (corner.z < near_m) return everything;
        all = hull(all, {of(corner) / corner.z, of(corner) / corner.z});
      }
    return all;
  }
  void meet(const double* x, const double* y, double* z, std::size_t count) const {
    for (std::size_t i = 0; i < count; ++i) z[i] = meet({x[i], y[i], 1});
  }
  double meet(Vec3 ray) const {
    const double towards = dot(n, ray);
    if (towards == 0) return 0;
    const double z = distance / towards;
    const Vec3 p = z * ray - centre;
    const double pu = dot(p, u), pv = dot(p, v);
    for (const auto& b : bands) {
      const double along = (pu - b.u) * b.eu + (pv - b.v) * b.ev;
      const double across = (pv - b.v) * b.eu - (pu - b.u) * b.ev;
      if (along >= 0 && along <= b.length && std::abs(across) <= b.half_width) return z;
    }
    return 0;
  }
  Vec3 normal(Vec3) const { return n; }
};

Interval tangents_x(const PlateShape& p) {
  return p.tangents([](Vec3 corner) { return corner.x; });
}
Interval tangents_y(const PlateShape& p) {
  return p.tangents([](Vec3 corner) { return corner.y; });
}

// A shape and the points of the axes between which it can be met.
template <class Shape>
struct Placed {
  Shape shape;
  std::uint32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;

  Placed(const Shape& s, const Axis& x, const Axis& y) : shape(s) {
    std::tie(x0, x1) = points_within(x, tangents_x(shape));
    std::tie(y0, y1) = points_within(y, tangents_y(shape));
  }
  bool in_row(std::uint32_t iy) const { return iy >= y0 && iy < y1 && x0 < x1; }
};

constexpr std::int32_t nothing = -1;
using Image = std::vector<Hit>;

// Goes through the image row by row, so that one row is all it holds. Coordinates are relative to
// the sensor, and rays are (tx, ty, 1), so that the ray parameter is z. Shapes are numbered:
// capsules, then plates.
class Scanner {
 public:
  Scanner(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y, Sampling sampling)
      : x_(x),
        y_(y),
        offsets_(x, y, sampling),
        ray_x_(x.count),
        ray_y_(x.count),
        met_(x.count),
        z_(x.count, INFINITY),
        shape_(x.count, nothing) {
    const Vec3 sensor{sensor_x_m, 0, 0};
    for (const auto& c : scene.capsules) capsules_.emplace_back(CapsuleShape(c, sensor), x, y);
    for (const auto& p : scene.plates) plates_.emplace_back(PlateShape(p, sensor), x, y);
    if (scene.room) background_ = room_image(sensor_x_m, x, y, sampling);
  }

  // emit(index of the pixel in the image, hit) for every ray that meets something.
  template <class Emit>
  void scan(Emit emit) {
    for (std::uint32_t iy = 0; iy < y_.count; ++iy) {
      draw_row(iy);
      if (background_)
        emit_before_background(iy, emit);
      else
        for (std::uint32_t ix = from_; ix < to_; ++ix)
          if (shape_[ix] != nothing) emit(std::size_t{iy} * x_.count + ix, hit(ix));
    }
  }

 private:
  static std::shared_ptr<const Image> room_image(double sensor_x_m, const Axis& x, const Axis& y,
                                                 Sampling sampling);

  template <class Emit>
  void emit_before_background(std::uint32_t iy, Emit emit) {
    const std::size_t row = std::size_t{iy} * x_.count;
    for (std::uint32_t ix = 0; ix < x_.count; ++ix) {
      const Hit& behind = (*background_)[row + ix];
      const bool in_front = ix >= from_ && ix < to_ && shape_[ix] != nothing &&
                            (behind.z_m <= 0 || static_cast<float>(z_[ix]) < behind.z_m);
      if (in_front)
        emit(row + ix, hit(ix));
      else if (behind.z_m > 0)
        emit(row + ix, behind);
    }
  }

  void draw_row(std::uint32_t iy) {
    from_ = x_.count;
    to_ = 0;
    const auto reach = [&](const auto& placed) {
      if (!placed.in_row(iy)) return;
      from_ = std::min(from_, placed.x0);
      to_ = std::max(to_, placed.x1);
    };
    for (const auto& capsule : capsules_) reach(capsule);
    for (const auto& plate : plates_) reach(plate);
    if (from_ >= to_) return;
    aim(iy);
    std::int32_t number = 0;
    for (const auto& capsule : capsules_) draw(capsule, number++, iy);
    for (const auto& plate : plates_) draw(plate, number++, iy);
  }

  // The rays of the row where there is something.
  void aim(std::uint32_t iy) {
    const double dx = offsets_.dx_of_row[iy], y = y_.at(iy);
    for (std::uint32_t ix = from_; ix < to_; ++ix) {
      const std::uint32_t mirror = x_.count - 1 - ix;
      ray_x_[ix] = x_.at(ix) + (ix < mirror ? -dx : ix > mirror ? dx : 0);
      ray_y_[ix] = y + offsets_.dy_of_column[ix];
      z_[ix] = INFINITY;
      shape_[ix] = nothing;
    }
  }

  template <class Shape>
  void draw(const Placed<Shape>& placed, std::int32_t number, std::uint32_t iy) {
    if (!placed.in_row(iy)) return;
    const std::size_t first = placed.x0, count = placed.x1 - placed.x0;
    placed.shape.meet(&ray_x_[first], &ray_y_[first], met_.data(), count);
    for (std::size_t i = 0; i < count; ++i) {
      const bool nearer = met_[i] > 0 && met_[i] < z_[first + i];
      z_[first + i] = nearer ? met_[i] : z_[first + i];
      shape_[first + i] = nearer ? number : shape_[first + i];
    }
  }

  Hit hit(std::uint32_t ix) const {
    const auto of = [&](const auto& shape) {
      const Vec3 ray{ray_x_[ix], ray_y_[ix], 1};
      const double z = z_[ix], stretch = length(ray);
      return Hit{static_cast<float>(z * stretch), static_cast<float>(z),
                 static_cast<float>(std::abs(dot(shape.normal(z * ray), ray)) / stretch),
                 static_cast<float>(shape.albedo)};
    };
    const auto number = static_cast<std::size_t>(shape_[ix]);
    return number < capsules_.size() ? of(capsules_[number].shape)
                                     : of(plates_[number - capsules_.size()].shape);
  }

  const Axis& x_;
  const Axis& y_;
  Offsets offsets_;
  std::vector<double> ray_x_, ray_y_, met_, z_;  // of one row
  std::vector<std::int32_t> shape_;
  std::uint32_t from_ = 0, to_ = 0;  // where the row may hold something
  std::vector<Placed<CapsuleShape>> capsules_;
  std::vector<Placed<PlateShape>> plates_;
  std::shared_ptr<const Image> background_;
};

// The room never moves: its image is made once for each sensor. Safe from any thread.
std::shared_ptr<const Image> Scanner::room_image(double sensor_x_m, const Axis& x, const Axis& y,
                                                 Sampling sampling) {
  static std::mutex mutex;
  static std::map<std::vector<double>, std::shared_ptr<const Image>> images;
  constexpr std::size_t most = 8;  // three belong to a data set
  const std::vector<double> key{sensor_x_m,
                                static_cast<double>(sampling),
                                x.start,
                                x.step,
                                y.start,
                                y.step,
                                static_cast<double>(x.count),
                                static_cast<double>(y.count)};
  const std::lock_guard lock(mutex);
  if (const auto known = images.find(key); known != images.end()) return known->second;
  Scene alone;
  alone.plates = room();
  if (images.size() == most) images.clear();
  return images[key] = std::make_shared<Image>(cast(alone, sensor_x_m, x, y, sampling));
}

void look(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y, double extra_m,
          Returns& returns) {
  const double pixel = std::abs(x.step * y.step) / mean_scene_weight;
  returns.range_m.clear();
  returns.weight.clear();
  Scanner(scene, sensor_x_m, x, y, Sampling::staggered).scan([&](std::size_t, const Hit& hit) {
    // dOmega = dtx dty / |(tx, ty, 1)|^3, and |(tx, ty, 1)| = R/z.
    const double shrink = hit.z_m / hit.range_m;
    const double solid_angle = pixel * shrink * shrink * shrink;
    const double range = hit.range_m, albedo = hit.albedo, cos_theta = hit.cos_theta;
    returns.range_m.push_back(range + extra_m);
    returns.weight.push_back(albedo * cos_theta * solid_angle / (range * range));
  });
}

Axis x_rays(std::int64_t count, double half_tangent) {
  return record::depth_x_axis(static_cast<std::uint32_t>(count), half_tangent);
}
Axis y_rays(std::int64_t count, double half_tangent) {
  return record::depth_y_axis(static_cast<std::uint32_t>(count), half_tangent);
}

}  // namespace

std::vector<Hit> cast(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y,
                      Sampling sampling) {
  std::vector<Hit> hits(std::size_t{x.count} * y.count);
  Scanner(scene, sensor_x_m, x, y, sampling).scan([&](std::size_t i, const Hit& hit) {
    hits[i] = hit;
  });
  return hits;
}

std::vector<std::uint16_t> render_depth_mm(const Scene& scene, const Axis& x, const Axis& y) {
  std::vector<std::uint16_t> depth(std::size_t{x.count} * y.count);
  Scanner(scene, 0, x, y, Sampling::centres).scan([&](std::size_t i, const Hit& hit) {
    const double z = hit.z_m;
    if (z <= record::max_depth_m) depth[i] = static_cast<std::uint16_t>(std::lround(1000 * z));
  });
  return depth;
}

void spd_returns(const Scene& scene, const Conditions& c, Returns& out) {
  const std::int64_t rays = rays_of(c);
  look(scene, 0, x_rays(rays, c.half_tangent), y_rays(rays, c.half_tangent),
       c.spd_delay_ps * speed_of_light_m_s / 2e12, out);
}

void radar_returns(const Scene& scene, const Conditions& c, Returns& out) {
  look(scene, -c.baseline_m, x_rays(c.radar_rays, c.radar_half_tangent),
       y_rays(c.radar_rays / 2, c.radar_half_tangent / 2), c.radar_bias_m, out);
}

Returns spd_returns(const Scene& scene, const Conditions& c) {
  Returns all;
  spd_returns(scene, c, all);
  return all;
}

Returns radar_returns(const Scene& scene, const Conditions& c) {
  Returns all;
  radar_returns(scene, c, all);
  return all;
}

}  // namespace echofuse::sim
