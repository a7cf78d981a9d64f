// SPDX-License-Identifier: MIT
// Capsules, plates and triangles in coordinates relative to a sensor. A ray is the line z (x, y,
// 1), so its parameter is the depth z. Functions process arrays of rays. Results are bit-for-bit
// identical on every machine.
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

// SIMD width in rays. The scalar remainder of a loop costs as much as several SIMD steps. Rows are
// therefore padded by `spare_rays`, and ray counts are rounded up to whole steps.
inline constexpr std::size_t rays_at_once = 4, spare_rays = 2 * rays_at_once;
constexpr std::size_t whole_steps(std::size_t rays) {
  return (rays + rays_at_once - 1) / rays_at_once * rays_at_once;
}

// Functions of every shape, for rays (x[i], y[i], 1):
//   meet       depth z at which ray i meets the shape; NaN or <= 0 if it does not
//   cosines    |cos| of the angle between the normal and ray i at depth z[i]
//   tangents_x, tangents_y  bounds of the tangents of rays that can meet the shape
struct CapsuleShape {
  Vec3 a, b, axis;
  double radius, albedo, axis2, axis_a, outside, end_a, end_b;

  CapsuleShape(const Capsule& c, Vec3 sensor);
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  void cosines(const double* x, const double* y, const double* z, double* cosine,
               std::size_t count) const;
  Interval tangents_x() const;
  Interval tangents_y() const;
  // Bounding box of the sphere at one end, in tangents. The convex hull of both boxes contains the
  // capsule.
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

// Neighbouring triangles both include their common edge, so that rays cannot pass between them.
struct TriangleShape {
  Vec3 a, b, c, normal;
  Vec3 edge_a, edge_b, edge_c;  // normals of the planes through the sensor and each edge
  double albedo, distance;

  TriangleShape(const Triangle& t, Vec3 sensor);
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  void cosines(const double* x, const double* y, const double* z, double* cosine,
               std::size_t count) const;
  Interval tangents_x() const;
  Interval tangents_y() const;
};

// Computes the rays of a row: ray_x = columns + dx sides, ray_y = y + dy. Clears the depth buffer.
void aim(const double* columns, const double* sides, const double* dy, double dx, double y,
         double* ray_x, double* ray_y, double* z, std::int32_t* shape, std::size_t count);

// Computes the slant range and the weight of each ray:
//   weight = factor albedo cos / |(x, y, 1)|^3 / range^2.
// If z is infinite, the range is infinite and the weight is 0.
void light_back(const double* x, const double* y, const double* z, const double* cosine,
                const double* albedo, double factor, double* range, double* weight,
                std::size_t count);

// Stores the depth and the number of the shape for each ray that meets this shape at a smaller
// depth than all previous shapes.
void keep_nearer(const double* met, std::int32_t number, double* z, std::int32_t* shape,
                 std::size_t count);

// Merges a background into a row: keeps the nearer of the two surfaces for each ray.
void put_behind(const double* far_z, const double* far_cosine, const double* far_albedo, double* z,
                double* cosine, double* albedo, std::size_t count);

}  // namespace echofuse::sim
