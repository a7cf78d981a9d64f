// SPDX-License-Identifier: MIT
// Rays against a capsule, many at a time.
#pragma once
#include <cstddef>

#include "sim/scene.hpp"

namespace echofuse::sim {

// A capsule as seen from a sensor: coordinates are relative to the sensor.
struct CapsuleShape {
  Vec3 a, b, axis;
  double radius, albedo, axis2, axis_a, outside, end_a, end_b;

  CapsuleShape(const Capsule& c, Vec3 sensor)
      : a(c.a - sensor),
        b(c.b - sensor),
        axis(b - a),
        radius(c.radius_m),
        albedo(c.albedo),
        axis2(dot(axis, axis)),
        axis_a(dot(axis, a)),
        outside(axis2 * (dot(a, a) - radius * radius) - axis_a * axis_a),
        end_a(dot(a, a) - radius * radius),
        end_b(dot(b, b) - radius * radius) {}

  // z at which ray i, (x[i], y[i], 1), meets the cylinder about a-b, else the sphere at the end on
  // whose side it passes; NaN or not above 0: it passes by. The same bits on every machine.
  void meet(const double* x, const double* y, double* z, std::size_t count) const;
  // At a point of the surface.
  Vec3 normal(Vec3 point) const;
};

}  // namespace echofuse::sim
