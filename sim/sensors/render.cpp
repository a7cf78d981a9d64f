// SPDX-License-Identifier: MIT
#include "sim/sensors/render.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "acquire/measurement/depth_map.hpp"
#include "sim/scene/person.hpp"
#include "sim/scene/shapes.hpp"
#include "sim/sensors/gaze.hpp"
#include "sim/sensors/multipath_light.hpp"
#include "sim/sensors/multipath_radar.hpp"
#include "sim/sensors/scanner.hpp"

namespace echofuse::sim {
namespace {

// Returns the origin of the patch hit by ray i of the row at this range.
Returns::PatchOrigin place_of(const Scene& scene, const ScanRow& row, std::size_t i, double range_m,
                              double sensor_height_m) {
  const double z = row.z[i];
  return {static_cast<float>(row.x[i] * z / range_m), static_cast<float>(row.y[i] * z / range_m),
          static_cast<float>(row.y[i] * z + sensor_height_m), person_of(scene, row.shape[i])};
}

// Collects the patches hit by the rays of each row, in the order of the rays.
class PatchCollector {
 public:
  PatchCollector(const Scene& scene, const Gaze& gaze, const Axis& x, const Axis& y,
                 Returns& returns)
      : scene_(scene),
        gaze_(gaze),
        // Pixel area dtx dty in tangents, divided by mean_scene_weight. light_back() converts the
        // area to a solid angle.
        pixel_(std::abs(x.step * y.step) / mean_scene_weight),
        returns_(returns) {
    returns.place.clear(), returns.tangent_x.clear(), returns.tangent_y.clear();
  }

  // Adds the patches of the rays first to last - 1 of the row. Their weights are multiplied by
  // `sign`.
  void add(const ScanRow& row, double sign, std::size_t first, std::size_t last) {
    const std::size_t count = last - first, needed = seen_ + count + spare_rays;
    if (returns_.range_m.size() < needed) {
      returns_.range_m.resize(2 * needed);
      returns_.weight.resize(2 * needed);
    }
    double *range = &returns_.range_m[seen_], *weight = &returns_.weight[seen_];
    light_back(row.x + first, row.y + first, row.z + first, row.cosine + first, row.albedo + first,
               sign * pixel_, range, weight, whole_steps(count));
    gaze_.dim({row.x + first, row.y + first, row.cosine + first, row.shape + first},
              static_cast<std::int32_t>(scene_.capsules.size()), weight, count);
    for (std::size_t i = 0; gaze_.height_m && i < count; ++i)
      returns_.place.push_back(place_of(scene_, row, first + i, range[i], *gaze_.height_m));
    if (gaze_.tangents) {
      returns_.tangent_x.insert(returns_.tangent_x.end(), row.x + first, row.x + last);
      returns_.tangent_y.insert(returns_.tangent_y.end(), row.y + first, row.y + last);
    }
    for (std::size_t i = 0; gaze_.extra_m != 0 && i < count; ++i) range[i] += gaze_.extra_m;
    for (std::size_t i = 0; gaze_.sway_m > 0 && i < count; ++i)
      if (row.shape[first + i] != nothing) range[i] += gaze_.sway(seen_ + i);
    seen_ += count;
  }
  void end() {
    returns_.range_m.resize(seen_);
    returns_.weight.resize(seen_);
  }

 private:
  const Scene& scene_;
  const Gaze& gaze_;
  double pixel_;
  Returns& returns_;
  std::size_t seen_ = 0;
};

void collect_patches(const Scene& scene, const Gaze& gaze, const Axis& x, const Axis& y,
                     RoomReturns room, Returns& returns) {
  constexpr Sampling sampling = Sampling::staggered;
  PatchCollector patches(scene, gaze, x, y, returns);
  std::shared_ptr<const Image> behind;
  std::vector<std::int32_t> no_shape;
  if (scene.room && room == RoomReturns::subtracted) {
    behind = Scanner::room_image(*scene.room, gaze.sensor_x_m, x, y, sampling);
    no_shape.assign(x.count + spare_rays, nothing);
  }
  Scanner(scene, gaze.sensor_x_m, x, y, sampling, room).scan(Shading::on, [&](const ScanRow& row) {
    if (!behind) {
      for (const auto& [first, last] : row.met) patches.add(row, 1, first, last);
      return;
    }
    const std::size_t at = std::size_t{row.iy} * x.count;
    ScanRow wall = row;
    wall.z = &behind->z[at], wall.cosine = &behind->cosine[at], wall.albedo = &behind->albedo[at];
    wall.shape = no_shape.data();
    const auto in_front = [&](std::size_t i) { return row.z[i] < wall.z[i]; };
    const auto hidden = [&](std::size_t i) { return in_front(i) && wall.z[i] < INFINITY; };
    for_each_run(row.from, row.to, in_front,
                 [&](std::size_t first, std::size_t last) { patches.add(row, 1, first, last); });
    for_each_run(row.from, row.to, hidden,
                 [&](std::size_t first, std::size_t last) { patches.add(wall, -1, first, last); });
  });
  patches.end();
}

Axis x_rays(std::int64_t count, double half_tangent) {
  return record::depth_x_axis(static_cast<std::uint32_t>(count), half_tangent);
}
Axis y_rays(std::int64_t count, double half_tangent) {
  return record::depth_y_axis(static_cast<std::uint32_t>(count), half_tangent);
}
Axis moved(Axis axis, double by) {
  axis.start += by;
  return axis;
}

void see_with_radar(const Scene& scene, const Conditions& c, const Gaze& gaze, const Axis& x,
                    const Axis& y, RoomReturns room, Returns& out) {
  collect_patches(scene, gaze, x, y, room, out);
  add_echoes_by_walls(scene, c, gaze, x, y, out);
}

}  // namespace

std::int32_t person_of(const Scene& scene, std::int32_t number) {
  const auto capsules = static_cast<std::int32_t>(scene.capsules.size());
  const auto plates = static_cast<std::int32_t>(scene.plates.size());
  if (number == nothing || number >= capsules + plates) return Returns::still;
  if (capsules == 0) return Returns::reflector;
  return number < capsules ? number / capsules_of_person : 0;
}

std::vector<Hit> cast(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y,
                      Sampling sampling) {
  std::vector<Hit> hits(std::size_t{x.count} * y.count);
  Scanner(scene, sensor_x_m, x, y, sampling).scan(Shading::on, [&](const ScanRow& row) {
    for (std::size_t ix = row.from; ix < row.to; ++ix) {
      const double z = row.z[ix];
      if (!(z < INFINITY)) continue;
      hits[std::size_t{row.iy} * x.count + ix] = {
          static_cast<float>(z * std::sqrt(row.x[ix] * row.x[ix] + row.y[ix] * row.y[ix] + 1)),
          static_cast<float>(z), static_cast<float>(row.cosine[ix]),
          static_cast<float>(row.albedo[ix])};
    }
  });
  return hits;
}

std::vector<std::uint16_t> render_depth_mm(const Scene& scene, const Axis& x, const Axis& y) {
  constexpr double max_m = 65.535;  // because depths are stored as u16 in mm
  std::vector<std::uint16_t> depth(std::size_t{x.count} * y.count);
  Scanner(scene, 0, x, y, Sampling::centres).scan(Shading::off, [&](const ScanRow& row) {
    for (std::size_t ix = row.from; ix < row.to; ++ix)
      if (row.z[ix] < max_m)
        depth[std::size_t{row.iy} * x.count + ix] =
            static_cast<std::uint16_t>(std::lround(1000 * row.z[ix]));
  });
  return depth;
}

void spd_returns(const Scene& scene, const Conditions& c, Returns& out, RoomReturns room) {
  const std::int64_t rays = rays_of(c);
  const Gaze gaze = spd_gaze(c);
  collect_patches(scene, gaze, moved(x_rays(rays, gaze.half_tangent), gaze.middle_x),
                  y_rays(rays, gaze.half_tangent), room, out);
  add_light_by_walls(scene, gaze, c.multipath_order, room, out);
}

void radar_returns(const Scene& scene, const Conditions& c, Returns& out, RoomReturns room) {
  const bool places = c.radar_antennas > 0 || c.radar_sum == "coherent";
  Gaze gaze = radar_gaze(c);
  if (places) gaze.height_m = c.camera_height_m;
  const Axis x = x_rays(c.radar_rays, radar_half_tangent);
  const Axis y = y_rays(c.radar_rays / 2, radar_half_tangent / 2);
  if (radar_sees_apart(scene))
    see_with_radar(as_radar_sees(scene), c, gaze, x, y, room, out);
  else
    see_with_radar(scene, c, gaze, x, y, room, out);
  if (c.radar_leakage <= 0) return;
  out.range_m.push_back(std::max(0.0, c.radar_bias_m));
  out.weight.push_back(c.radar_leakage);
  if (places) out.place.push_back({0, 0, 0, Returns::leakage});
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
