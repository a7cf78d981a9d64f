// SPDX-License-Identifier: MIT
// Capsules, plates and triangles relative to a sensor. Rays are (x, y, 1), so the ray parameter is
// z. Rays are processed in batches, with identical bits on every machine.
#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

struct Interval {
  double low, high;
};
inline Interval hull(Interval a, Interval b) {
  return {std::min(a.low, b.low), std::max(a.high, b.high)};
}

// SIMD width in rays. A remainder costs as much as several full steps, so rows are padded and
// counts are rounded up at either end.
inline constexpr std::size_t rays_at_once = 4, spare_rays = 2 * rays_at_once;
constexpr std::size_t whole_steps(std::size_t rays) {
  return (rays + rays_at_once - 1) / rays_at_once * rays_at_once;
}

// Every shape has
//   meet     depth z at which ray i, (x[i], y[i], 1), meets it; NaN or <= 0: no intersection
//   cosines  |cos| between normal and ray i at depth z[i]
//   tangents_x, tangents_y  bounds of the tangents at which it can be met
struct CapsuleShape {
  Vec3 a, b, axis;
  double radius, albedo, axis2, axis_a, outside, end_a, end_b;

  CapsuleShape(const Capsule& c, Vec3 sensor);
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  void cosines(const double* x, const double* y, const double* z, double* cosine,
               std::size_t count) const;
  Interval tangents_x() const;
  Interval tangents_y() const;
  // Bounding box of the spheres at its ends; the part between them is inside their convex hull.
  struct BoundingBox {
    Interval x, y;
  };
  std::array<BoundingBox, 2> ends() const;
};

struct PlateShape {
  struct Band {
    double u, v, eu, ev, length, half_width;
  };
  Vec3 centre, u, v, normal;
  double albedo, distance;
  std::vector<Band> bands;
  Interval u_range, v_range;

  PlateShape(const Plate& p, Vec3 sensor);
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  void cosines(const double* x, const double* y, const double* z, double* cosine,
               std::size_t count) const;
  Interval tangents_x() const;
  Interval tangents_y() const;
  std::array<Vec3, 4> corners() const;
};

// Triangles with a common edge both include it, so that no ray passes between them.
struct TriangleShape {
  Vec3 a, b, c, normal;
  Vec3 edge_a, edge_b, edge_c;  // normals of the planes through the sensor and one edge
  double albedo, distance;

  TriangleShape(const Triangle& t, Vec3 sensor);
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  void cosines(const double* x, const double* y, const double* z, double* cosine,
               std::size_t count) const;
  Interval tangents_x() const;
  Interval tangents_y() const;
};

// Computes the rays of a row, offset from their columns by dx to either side, and clears the depth
// buffer.
void aim(const double* columns, const double* sides, const double* dy, double dx, double y,
         double* ray_x, double* ray_y, double* z, std::int32_t* shape, std::size_t count);

// Computes slant range and weight = factor albedo cos / |(x, y, 1)|^3 / range^2 of each ray; both
// are 0 where z is infinite.
void light_back(const double* x, const double* y, const double* z, const double* cosine,
                const double* albedo, double factor, double* range, double* weight,
                std::size_t count);

// Stores depth and shape `number` for each ray that meets it nearer than its current depth.
void keep_nearer(const double* met, std::int32_t number, double* z, std::int32_t* shape,
                 std::size_t count);

// Merges another surface: keeps the nearer of both for each ray.
void put_behind(const double* far_z, const double* far_cosine, const double* far_albedo, double* z,
                double* cosine, double* albedo, std::size_t count);

}  // namespace echofuse::sim
