// SPDX-License-Identifier: MIT
#include "sim/sensors/multipath_patches.hpp"

#include <cmath>
#include <numbers>

#include "sim/scene/room.hpp"
#include "sim/sensors/scanner.hpp"

namespace echofuse::sim {

std::vector<Patch> patches_of(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y) {
  constexpr double min_cosine = 0.02;
  const double pixel = std::abs(x.step * y.step);
  std::vector<Patch> out;
  Scanner scanner(scene, sensor_x_m, x, y, Sampling::staggered, RoomReturns::subtracted);
  scanner.scan(Shading::on, [&](const ScanRow& row) {
    for (std::size_t i = row.from; i < row.to; ++i) {
      if (!(row.z[i] < INFINITY) || row.cosine[i] < min_cosine) continue;
      const Vec3 ray{row.x[i], row.y[i], 1};
      const double long_ray = length(ray);
      const Vec3 at = row.z[i] * ray;
      // Solid angle of a ray with tangents tx and ty: dOmega = dtx dty / |(tx, ty, 1)|^3.
      out.push_back({at, scanner.normal(row.shape[i], at), (1 / long_ray) * ray,
                     row.z[i] * long_ray, row.albedo[i], row.cosine[i],
                     pixel / (long_ray * long_ray * long_ray), row.shape[i],
                     static_cast<std::uint32_t>(row.iy * x.count + i)});
    }
  });
  return out;
}

std::vector<Patch> patches_of(const Room& room, double sensor_x_m, const Axis& x, const Axis& y) {
  Scene alone;
  alone.plates = room.plates;
  return patches_of(alone, sensor_x_m, x, y);
}

double form_factor(const Patch& to, const Patch& from) {
  const Vec3 way = to.at - from.at;
  const double leaves = dot(from.normal, way), arrives = -dot(to.normal, way);
  if (leaves <= 0 || arrives <= 0) return 0;
  const double d2 = dot(way, way), area = from.area_m2();
  return area * leaves * arrives / (d2 * (std::numbers::pi * d2 + area));
}

}  // namespace echofuse::sim
