// SPDX-License-Identifier: MIT
// Compiled without errno and floating-point traps (CMakeLists.txt), so that the compiler vectorises
// loops with square roots.
#include "sim/scene/shapes.hpp"

#include <cmath>

#include "drivers/core/clones.hpp"

namespace echofuse::sim {
namespace {

// Shapes that extend to a z below this value are tested against every ray, because the tangents of
// their outlines are unbounded.
constexpr double near_m = 0.05;
constexpr Interval everything{-INFINITY, INFINITY}, none{INFINITY, -INFINITY};

// Returns the interval of tangents t covered along one axis by a sphere with its centre at (s, z).
// The limits of the interval are the exact silhouette: (s - t z)^2 = radius^2 (1 + t^2).
Interval disc_tangents(double s, double z, double radius) {
  if (z - radius < near_m) return everything;
  const double square = z * z - radius * radius;
  const double middle = s * z, half = radius * std::sqrt(s * s + square);
  return {(middle - half) / square, (middle + half) / square};
}

template <class Corners, class Coordinate>
Interval corner_tangents(const Corners& corners, Coordinate of) {
  Interval all = none;
  for (const Vec3& corner : corners) {
    if (corner.z < near_m) return everything;
    all = hull(all, {of(corner) / corner.z, of(corner) / corner.z});
  }
  return all;
}
constexpr auto x_of = [](Vec3 p) { return p.x; };
constexpr auto y_of = [](Vec3 p) { return p.y; };

ECHOFUSE_CLONES void meet_capsule(const CapsuleShape& c, const double* x, const double* y,
                                  double* z, std::size_t count) {
  const CapsuleShape s = c;  // local copy, because stores to z[i] could alias c
  for (std::size_t i = 0; i < count; ++i) {
    const double ray2 = x[i] * x[i] + y[i] * y[i] + 1;
    const double along = s.axis.x * x[i] + s.axis.y * y[i] + s.axis.z;
    const double to_a = s.a.x * x[i] + s.a.y * y[i] + s.a.z;
    const double to_b = s.b.x * x[i] + s.b.y * y[i] + s.b.z;
    // 0 if the ray is parallel to the axis, or if the axis is a point
    const double square = s.axis2 * ray2 - along * along;
    const double half = s.axis2 * to_a - s.axis_a * along;
    const double root = half * half - square * s.outside;
    // The point where the ray meets the infinite cylinder is at the axis position foot = from_a -
    // sqrt(root) along: 0 at end a, axis2 * square at end b. Comparing signed squares avoids the
    // square root.
    const double from_a = half * along - s.axis_a * square, from_b = from_a - s.axis2 * square;
    const double bound = along * std::abs(along) * root;
    const bool after_a = from_a * std::abs(from_a) > bound;
    const bool before_b = from_b * std::abs(from_b) < bound;
    const bool parallel = square <= 1e-12 * s.axis2 * ray2;
    const bool at_b = parallel ? along <= 0 : after_a;
    const double to_end = at_b ? to_b : to_a;
    const double end_root = to_end * to_end - ray2 * (at_b ? s.end_b : s.end_a);
    const bool at_side = !parallel & after_a & before_b;
    const double met = ((at_side ? half : to_end) - std::sqrt(at_side ? root : end_root)) /
                       (at_side ? square : ray2);
    z[i] = (!parallel & (root < 0)) ? 0 : met;
  }
}

ECHOFUSE_CLONES void shade_capsule(const CapsuleShape& c, const double* x, const double* y,
                                   const double* z, double* cosine, std::size_t count) {
  const CapsuleShape s = c;
  const double per_axis2 = s.axis2 > 0 ? 1 / s.axis2 : 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double foot_raw =
        (z[i] * (s.axis.x * x[i] + s.axis.y * y[i] + s.axis.z) - s.axis_a) * per_axis2;
    const double foot = foot_raw < 0 ? 0 : foot_raw > 1 ? 1 : foot_raw;
    const double nx = z[i] * x[i] - s.a.x - foot * s.axis.x;
    const double ny = z[i] * y[i] - s.a.y - foot * s.axis.y;
    const double nz = z[i] - s.a.z - foot * s.axis.z;
    const double ray = std::sqrt(x[i] * x[i] + y[i] * y[i] + 1);
    cosine[i] = std::abs(nx * x[i] + ny * y[i] + nz) / (ray * s.radius);
  }
}

ECHOFUSE_CLONES void meet_triangle(const TriangleShape& t, const double* x, const double* y,
                                   double* z, std::size_t count) {
  const Vec3 n = t.normal, p = t.edge_a, q = t.edge_b, r = t.edge_c;
  const double distance = t.distance;
  for (std::size_t i = 0; i < count; ++i) {
    const double a = p.x * x[i] + p.y * y[i] + p.z;
    const double b = q.x * x[i] + q.y * y[i] + q.z;
    const double c = r.x * x[i] + r.y * y[i] + r.z;
    const bool inside = ((a >= 0) & (b >= 0) & (c >= 0)) | ((a <= 0) & (b <= 0) & (c <= 0));
    const double met = distance / (n.x * x[i] + n.y * y[i] + n.z);
    z[i] = inside ? met : 0;
  }
}

// Computes the depth and the plate coordinates of the points where rays cross the plane of the
// plate.
ECHOFUSE_CLONES void cross_plane(const PlateShape& p, const double* x, const double* y,
                                 double* __restrict met, double* __restrict along_u,
                                 double* __restrict along_v, std::size_t count) {
  const Vec3 normal = p.normal, centre = p.centre, u = p.u, v = p.v;
  const double distance = p.distance;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 ray{x[i], y[i], 1};
    const double towards = dot(normal, ray), z = distance / towards;
    const Vec3 at = z * ray - centre;
    met[i] = towards == 0 ? 0 : z;
    along_u[i] = dot(at, u), along_v[i] = dot(at, v);
  }
}

ECHOFUSE_CLONES void meet_band(const PlateShape::Band& band, const double* met, const double* u,
                               const double* v, double* __restrict z, std::size_t count) {
  const PlateShape::Band b = band;
  for (std::size_t i = 0; i < count; ++i) {
    const double along = (u[i] - b.u) * b.eu + (v[i] - b.v) * b.ev;
    const double across = (v[i] - b.v) * b.eu - (u[i] - b.u) * b.ev;
    const bool inside = (along >= 0) & (along <= b.length) & (std::abs(across) <= b.half_width);
    const double before = z[i];
    z[i] = inside ? met[i] : before;
  }
}

ECHOFUSE_CLONES void aim_rays(const double* columns, const double* sides, const double* dy,
                              double dx, double row_y, double* __restrict x, double* __restrict y,
                              double* __restrict z, std::int32_t* __restrict shape,
                              std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    x[i] = columns[i] + dx * sides[i];
    y[i] = row_y + dy[i];
    z[i] = INFINITY;
    shape[i] = -1;
  }
}

// Computes |cos| of the angle of incidence on a flat surface with unit normal n.
ECHOFUSE_CLONES void shade_flat(Vec3 n, const double* x, const double* y, double* cosine,
                                std::size_t count) {
  for (std::size_t i = 0; i < count; ++i)
    cosine[i] = std::abs(n.x * x[i] + n.y * y[i] + n.z) / std::sqrt(x[i] * x[i] + y[i] * y[i] + 1);
}

ECHOFUSE_CLONES void light_rays(const double* __restrict x, const double* __restrict y,
                                const double* __restrict z, const double* __restrict cosine,
                                const double* __restrict albedo, double factor,
                                double* __restrict range, double* __restrict weight,
                                std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const double ray2 = x[i] * x[i] + y[i] * y[i] + 1, ray = std::sqrt(ray2);
    const double r = z[i] * ray;
    range[i] = r;
    weight[i] = factor * albedo[i] * cosine[i] / (ray2 * ray * r * r);
  }
}

ECHOFUSE_CLONES void choose_met(const double* __restrict met, std::int32_t number,
                                double* __restrict z, std::int32_t* __restrict shape,
                                std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const double old_z = z[i];
    const std::int32_t old_shape = shape[i];
    const bool nearer = (met[i] > 0) & (met[i] < old_z);
    z[i] = nearer ? met[i] : old_z;
    shape[i] = nearer ? number : old_shape;
  }
}

ECHOFUSE_CLONES void choose_nearer(const double* __restrict far_z,
                                   const double* __restrict far_cosine,
                                   const double* __restrict far_albedo, double* __restrict z,
                                   double* __restrict cosine, double* __restrict albedo,
                                   std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const double mine_z = z[i], mine_cosine = cosine[i], mine_albedo = albedo[i];
    const double other_z = far_z[i], other_cosine = far_cosine[i], other_albedo = far_albedo[i];
    const bool nearer = mine_z < other_z;
    z[i] = nearer ? mine_z : other_z;
    cosine[i] = nearer ? mine_cosine : other_cosine;
    albedo[i] = nearer ? mine_albedo : other_albedo;
  }
}

}  // namespace

CapsuleShape::CapsuleShape(const Capsule& capsule, Vec3 sensor)
    : a(capsule.a - sensor),
      b(capsule.b - sensor),
      axis(b - a),
      radius(capsule.radius_m),
      albedo(capsule.albedo),
      axis2(dot(axis, axis)),
      axis_a(dot(axis, a)),
      outside(axis2 * (dot(a, a) - radius * radius) - axis_a * axis_a),
      end_a(dot(a, a) - radius * radius),
      end_b(dot(b, b) - radius * radius) {}

// Computes the depth at which each ray meets the cylinder around a-b or, beyond its ends, the
// sphere at the nearer end.
void CapsuleShape::meet(const double* x, const double* y, double* z, std::size_t count) const {
  meet_capsule(*this, x, y, z, count);
}
void CapsuleShape::cosines(const double* x, const double* y, const double* z, double* cosine,
                           std::size_t count) const {
  shade_capsule(*this, x, y, z, cosine, count);
}
std::array<CapsuleShape::BoundingBox, 2> CapsuleShape::ends() const {
  const auto box = [&](Vec3 end) {
    return BoundingBox{disc_tangents(end.x, end.z, radius), disc_tangents(end.y, end.z, radius)};
  };
  return {box(a), box(b)};
}
Interval CapsuleShape::tangents_x() const {
  const auto [of_a, of_b] = ends();
  return hull(of_a.x, of_b.x);
}
Interval CapsuleShape::tangents_y() const {
  const auto [of_a, of_b] = ends();
  return hull(of_a.y, of_b.y);
}

PlateShape::PlateShape(const Plate& p, Vec3 sensor)
    : centre(p.centre - sensor),
      u(p.u),
      v(p.v),
      normal(cross(u, v)),
      albedo(p.albedo),
      distance(dot(normal, centre)),
      u_range(none),
      v_range(none) {
  for (const auto& s : p.strokes) {
    const double du = s.u1 - s.u0, dv = s.v1 - s.v0, reach = std::hypot(du, dv);
    const double half = s.width_m / 2;
    bands.push_back({s.u0, s.v0, du / reach, dv / reach, reach, half});
    u_range = hull(u_range, {std::min(s.u0, s.u1) - half, std::max(s.u0, s.u1) + half});
    v_range = hull(v_range, {std::min(s.v0, s.v1) - half, std::max(s.v0, s.v1) + half});
  }
}
void PlateShape::meet(const double* x, const double* y, double* z, std::size_t count) const {
  constexpr std::size_t some = 64;
  std::array<double, some> met, pu, pv;
  for (std::size_t first = 0; first < count; first += some) {
    const std::size_t rays = std::min(some, count - first);
    cross_plane(*this, x + first, y + first, met.data(), pu.data(), pv.data(), rays);
    std::fill_n(z + first, rays, 0.0);
    for (const Band& band : bands)
      meet_band(band, met.data(), pu.data(), pv.data(), z + first, rays);
  }
}
void PlateShape::cosines(const double* x, const double* y, const double*, double* cosine,
                         std::size_t count) const {
  shade_flat(normal, x, y, cosine, count);
}
Interval PlateShape::tangents_x() const { return corner_tangents(corners(), x_of); }
Interval PlateShape::tangents_y() const { return corner_tangents(corners(), y_of); }
std::array<Vec3, 4> PlateShape::corners() const {
  const auto at = [&](double pu, double pv) { return centre + pu * u + pv * v; };
  return {at(u_range.low, v_range.low), at(u_range.low, v_range.high),
          at(u_range.high, v_range.low), at(u_range.high, v_range.high)};
}

TriangleShape::TriangleShape(const Triangle& t, Vec3 sensor)
    : a(t.a - sensor),
      b(t.b - sensor),
      c(t.c - sensor),
      normal(cross(b - a, c - a)),
      edge_a(cross(b, c)),
      edge_b(cross(c, a)),
      edge_c(cross(a, b)),
      albedo(t.albedo) {
  normal = (1 / length(normal)) * normal;
  distance = dot(normal, a);
}
void TriangleShape::meet(const double* x, const double* y, double* z, std::size_t count) const {
  meet_triangle(*this, x, y, z, count);
}
void TriangleShape::cosines(const double* x, const double* y, const double*, double* cosine,
                            std::size_t count) const {
  shade_flat(normal, x, y, cosine, count);
}
Interval TriangleShape::tangents_x() const { return corner_tangents(std::array{a, b, c}, x_of); }
Interval TriangleShape::tangents_y() const { return corner_tangents(std::array{a, b, c}, y_of); }

void aim(const double* columns, const double* sides, const double* dy, double dx, double y,
         double* ray_x, double* ray_y, double* z, std::int32_t* shape, std::size_t count) {
  aim_rays(columns, sides, dy, dx, y, ray_x, ray_y, z, shape, count);
}

void light_back(const double* x, const double* y, const double* z, const double* cosine,
                const double* albedo, double factor, double* range, double* weight,
                std::size_t count) {
  light_rays(x, y, z, cosine, albedo, factor, range, weight, count);
}

void keep_nearer(const double* met, std::int32_t number, double* z, std::int32_t* shape,
                 std::size_t count) {
  choose_met(met, number, z, shape, count);
}

void put_behind(const double* far_z, const double* far_cosine, const double* far_albedo, double* z,
                double* cosine, double* albedo, std::size_t count) {
  choose_nearer(far_z, far_cosine, far_albedo, z, cosine, albedo, count);
}

}  // namespace echofuse::sim
