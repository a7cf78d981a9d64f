// SPDX-License-Identifier: MIT
// Capsules, plates and triangles as seen from a sensor. Coordinates are relative to it, and rays
// are (x, y, 1), so that the ray parameter is z. Many rays are worked on at a time, with the same
// bits on every machine.
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

// So many rays are worked on at once where the processor can. A rest costs as much as several
// steps: rows have rays to spare, so that counts can be made whole at either end.
inline constexpr std::size_t rays_at_once = 4, spare_rays = 2 * rays_at_once;
constexpr std::size_t whole_steps(std::size_t rays) {
  return (rays + rays_at_once - 1) / rays_at_once * rays_at_once;
}

// Every shape has
//   meet     z at which ray i, (x[i], y[i], 1), meets it; NaN or not above 0: it passes by
//   cosines  |cos| between normal and ray where ray i met it at z[i]
//   tangents_x, tangents_y  where it can be met
struct CapsuleShape {
  Vec3 a, b, axis;
  double radius, albedo, axis2, axis_a, outside, end_a, end_b;

  CapsuleShape(const Capsule& c, Vec3 sensor);
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  void cosines(const double* x, const double* y, const double* z, double* cosine,
               std::size_t count) const;
  Interval tangents_x() const;
  Interval tangents_y() const;
  // Bounding box of the spheres at its ends; the part between them is met within the hull of both.
  struct Box {
    Interval x, y;
  };
  std::array<Box, 2> ends() const;
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

// An edge shared by two triangles belongs to both, so that no ray slips through between them.
struct TriangleShape {
  Vec3 a, b, c, normal;
  Vec3 edge_a, edge_b, edge_c;  // normals of the planes through the sensor and one edge each
  double albedo, distance;

  TriangleShape(const Triangle& t, Vec3 sensor);
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  void cosines(const double* x, const double* y, const double* z, double* cosine,
               std::size_t count) const;
  Interval tangents_x() const;
  Interval tangents_y() const;
};

// Makes the rays of a row, off their columns by dx to either side; none has met anything yet.
void aim(const double* columns, const double* sides, const double* dy, double dx, double y,
         double* ray_x, double* ray_y, double* z, std::int32_t* shape, std::size_t count);

// Computes slant range and weight = factor albedo cos / |(x, y, 1)|^3 / range^2 of each ray; they
// are 0 where z is infinite.
void light_back(const double* x, const double* y, const double* z, const double* cosine,
                const double* albedo, double factor, double* range, double* weight,
                std::size_t count);

// Sets shape `number` and its depth for each ray that met it nearer than anything so far.
void keep_nearer(const double* met, std::int32_t number, double* z, std::int32_t* shape,
                 std::size_t count);

// Puts another surface behind what was met; keeps the nearer of both.
void put_behind(const double* far_z, const double* far_cosine, const double* far_albedo, double* z,
                double* cosine, double* albedo, std::size_t count);

}  // namespace echofuse::sim
