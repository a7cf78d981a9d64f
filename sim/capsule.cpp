// SPDX-License-Identifier: MIT
// Compiled without errno and traps for its square roots (CMakeLists.txt), so that they vectorise.
#include "sim/capsule.hpp"

#include <algorithm>
#include <cmath>

namespace echofuse::sim {
namespace {

// Not FMA: contracted products would make other bits. Sanitizers are not up yet when the loader
// chooses a clone.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define ECHOFUSE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ECHOFUSE_CLONES
#endif

ECHOFUSE_CLONES void meet_rays(const CapsuleShape& c, const double* x, const double* y, double* z,
                               std::size_t count) {
  const CapsuleShape s = c;  // no store to z can change it
  for (std::size_t i = 0; i < count; ++i) {
    const double ray2 = x[i] * x[i] + y[i] * y[i] + 1;
    const double along = s.axis.x * x[i] + s.axis.y * y[i] + s.axis.z;
    const double to_a = s.a.x * x[i] + s.a.y * y[i] + s.a.z;
    const double to_b = s.b.x * x[i] + s.b.y * y[i] + s.b.z;
    const double square = s.axis2 * ray2 - along * along;  // 0: parallel, or the axis is a point
    const double half = s.axis2 * to_a - s.axis_a * along;
    const double root = half * half - square * s.outside;
    const double on_side = (half - std::sqrt(root)) / square;
    const double foot = on_side * along - s.axis_a;
    const bool parallel = square <= 1e-12 * s.axis2 * ray2;
    const bool at_a = parallel ? along > 0 : foot <= 0;
    const double to_end = at_a ? to_a : to_b;
    const double end_root = to_end * to_end - ray2 * (at_a ? s.end_a : s.end_b);
    const double on_end = (to_end - std::sqrt(end_root)) / ray2;
    const bool beside = !parallel & (foot > 0) & (foot < s.axis2);
    const double met = beside ? on_side : on_end;
    z[i] = !parallel & (root < 0) ? 0 : met;
  }
}

}  // namespace

void CapsuleShape::meet(const double* x, const double* y, double* z, std::size_t count) const {
  meet_rays(*this, x, y, z, count);
}

Vec3 CapsuleShape::normal(Vec3 point) const {
  const double foot = axis2 > 0 ? std::clamp((dot(point, axis) - axis_a) / axis2, 0.0, 1.0) : 0.0;
  return (1 / radius) * (point - a - foot * axis);
}

}  // namespace echofuse::sim
