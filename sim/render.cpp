// SPDX-License-Identifier: MIT
#include "sim/render.hpp"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>
#include <tuple>
#include <utility>

#include "acquire/record/depth_map.hpp"
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

// Ray against a cylinder about a-b, else against the sphere at the end on whose side it passes.
struct CapsuleShape {
  Vec3 a, b, axis;
  double radius, albedo, axis2, axis_a, outside;

  CapsuleShape(const Capsule& c, Vec3 sensor)
      : a(c.a - sensor),
        b(c.b - sensor),
        axis(b - a),
        radius(c.radius_m),
        albedo(c.albedo),
        axis2(dot(axis, axis)),
        axis_a(dot(axis, a)),
        outside(axis2 * (dot(a, a) - radius * radius) - axis_a * axis_a) {}

  Interval tangents_x() const {
    return hull(disc_tangents(a.x, a.z, radius), disc_tangents(b.x, b.z, radius));
  }
  Interval tangents_y() const {
    return hull(disc_tangents(a.y, a.z, radius), disc_tangents(b.y, b.z, radius));
  }
  double meet(Vec3 ray) const {
    const double along = dot(axis, ray), ray2 = dot(ray, ray);
    const double square = axis2 * ray2 - along * along;  // 0: parallel, or the axis is a point
    if (square <= 1e-12 * axis2 * ray2) return meet_sphere(along > 0 ? a : b, ray, ray2);
    const double half = axis2 * dot(ray, a) - axis_a * along;
    const double root = half * half - square * outside;
    if (root < 0) return 0;
    const double z = (half - std::sqrt(root)) / square;
    const double foot = z * along - axis_a;
    if (foot > 0 && foot < axis2) return z;
    return meet_sphere(foot <= 0 ? a : b, ray, ray2);
  }
  double meet_sphere(Vec3 centre, Vec3 ray, double ray2) const {
    const double half = dot(centre, ray);
    const double root = half * half - ray2 * (dot(centre, centre) - radius * radius);
    return root < 0 ? 0 : (half - std::sqrt(root)) / ray2;
  }
  Vec3 normal(Vec3 point) const {
    const double foot = axis2 > 0 ? std::clamp((dot(point, axis) - axis_a) / axis2, 0.0, 1.0) : 0.0;
    return (1 / radius) * (point - a - foot * axis);
  }
};

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
  Interval tangents_x() const {
    return tangents([](Vec3 p) { return p.x; });
  }
  Interval tangents_y() const {
    return tangents([](Vec3 p) { return p.y; });
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

// A shape and the points of the axes between which it can be met.
template <class Shape>
struct Placed {
  Shape shape;
  std::uint32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;

  Placed(const Shape& s, const Axis& x, const Axis& y) : shape(s) {
    std::tie(x0, x1) = points_within(x, shape.tangents_x());
    std::tie(y0, y1) = points_within(y, shape.tangents_y());
  }
};

// Goes through the image row by row, so that one row of hits is all it holds. Coordinates are
// relative to the sensor, and rays are (tx, ty, 1), so that the ray parameter is z.
class Scanner {
 public:
  Scanner(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y, Sampling sampling)
      : x_(x), y_(y), offsets_(x, y, sampling), row_(x.count) {
    const Vec3 sensor{sensor_x_m, 0, 0};
    for (const auto& c : scene.capsules) capsules_.emplace_back(CapsuleShape(c, sensor), x, y);
    for (const auto& p : scene.plates) plates_.emplace_back(PlateShape(p, sensor), x, y);
    if (scene.room)
      for (const auto& p : room()) plates_.emplace_back(PlateShape(p, sensor), x, y);
  }

  // emit(index of the pixel in the image, hit) for every ray that meets something.
  template <class Emit>
  void scan(Emit emit) {
    for (std::uint32_t iy = 0; iy < y_.count; ++iy) {
      from_ = x_.count;
      to_ = 0;
      for (const auto& capsule : capsules_) draw(capsule, iy);
      for (const auto& plate : plates_) draw(plate, iy);
      for (std::uint32_t ix = from_; ix < to_; ++ix) {
        if (row_[ix].z_m > 0) emit(std::size_t{iy} * x_.count + ix, row_[ix]);
        row_[ix] = {};
      }
    }
  }

 private:
  template <class Shape>
  void draw(const Placed<Shape>& placed, std::uint32_t iy) {
    if (iy < placed.y0 || iy >= placed.y1) return;
    from_ = std::min(from_, placed.x0);
    to_ = std::max(to_, placed.x1);
    for (std::uint32_t ix = placed.x0; ix < placed.x1; ++ix) {
      const Vec3 ray = ray_at(ix, iy);
      const double z = placed.shape.meet(ray);
      Hit& hit = row_[ix];
      if (z <= 0 || (hit.z_m > 0 && static_cast<float>(z) >= hit.z_m)) continue;
      const double stretch = length(ray);
      hit = {static_cast<float>(z * stretch), static_cast<float>(z),
             static_cast<float>(std::abs(dot(placed.shape.normal(z * ray), ray)) / stretch),
             static_cast<float>(placed.shape.albedo)};
    }
  }
  Vec3 ray_at(std::uint32_t ix, std::uint32_t iy) const {
    const double dx = offsets_.dx_of_row[iy];
    const std::uint32_t mirror = x_.count - 1 - ix;
    return {x_.at(ix) + (ix < mirror   ? -dx
                         : ix > mirror ? dx
                                       : 0),
            y_.at(iy) + offsets_.dy_of_column[ix], 1};
  }

  const Axis& x_;
  const Axis& y_;
  Offsets offsets_;
  std::vector<Hit> row_;
  std::uint32_t from_ = 0, to_ = 0;
  std::vector<Placed<CapsuleShape>> capsules_;
  std::vector<Placed<PlateShape>> plates_;
};

Returns returns_of(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y) {
  const double pixel = std::abs(x.step * y.step) / mean_scene_weight;
  Returns returns;
  Scanner(scene, sensor_x_m, x, y, Sampling::staggered).scan([&](std::size_t, const Hit& hit) {
    // dOmega = dtx dty / |(tx, ty, 1)|^3, and |(tx, ty, 1)| = R/z.
    const double shrink = hit.z_m / hit.range_m;
    const double solid_angle = pixel * shrink * shrink * shrink;
    const double range = hit.range_m, albedo = hit.albedo, cos_theta = hit.cos_theta;
    returns.range_m.push_back(range);
    returns.weight.push_back(albedo * cos_theta * solid_angle / (range * range));
  });
  return returns;
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

Returns spd_returns(const Scene& scene, const Conditions& c) {
  Returns all =
      returns_of(scene, 0, x_rays(c.spd_rays, c.half_tangent), y_rays(c.spd_rays, c.half_tangent));
  const double delay_m = c.spd_delay_ps * speed_of_light_m_s / 2e12;
  for (double& range : all.range_m) range += delay_m;
  return all;
}

Returns radar_returns(const Scene& scene, const Conditions& c) {
  Returns all = returns_of(scene, -c.baseline_m, x_rays(c.radar_rays, c.radar_half_tangent),
                           y_rays(c.radar_rays / 2, c.radar_half_tangent / 2));
  for (double& range : all.range_m) range += c.radar_bias_m;
  return all;
}

}  // namespace echofuse::sim
