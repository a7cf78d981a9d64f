// SPDX-License-Identifier: MIT
#include "sim/sensors/multipath_light.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "acquire/measurement/depth_map.hpp"
#include "sim/sensors/gaze.hpp"
#include "sim/sensors/multipath_patches.hpp"

namespace echofuse::sim {
namespace {

using Patches = std::vector<Patch>;

struct Grid {
  Axis x, y;
  Grid(const Gaze& gaze, std::int64_t rays)
      : x(record::depth_x_axis(static_cast<std::uint32_t>(rays), gaze.half_tangent)),
        y(record::depth_y_axis(static_cast<std::uint32_t>(rays), gaze.half_tangent)) {
    x.start += gaze.middle_x;
  }
};

// Returns the falloff in one direction of travel. Gaze::falloff applies to both directions
// together.
double dimming(const Gaze& gaze, const Patch& p) {
  if (gaze.falloff <= 0) return 1;
  const double dx = p.at.x / p.at.z - gaze.middle_x, dy = p.at.y / p.at.z;
  return std::exp(-gaze.falloff * (dx * dx + dy * dy) /
                  (2 * gaze.half_tangent * gaze.half_tangent));
}

// Returns the wall patches that are not hidden by a body.
Patches lit_walls(const Scene& scene, const Gaze& gaze, const Grid& grid) {
  Patches walls = patches_of(*scene.room, gaze.sensor_x_m, grid.x, grid.y);
  std::vector<double> body_m(std::size_t{grid.x.count} * grid.y.count, INFINITY);
  for (const Patch& p : patches_of(scene, gaze.sensor_x_m, grid.x, grid.y))
    body_m[p.ray] = p.range_m;
  std::erase_if(walls, [&](const Patch& p) { return body_m[p.ray] < p.range_m; });
  return walls;
}

// Bin width and limit of the histograms of light by path length, m. The limit exceeds the window of
// any SPD histogram.
constexpr double step_m = 0.05, longest_m = 30;
class ByLength {
 public:
  double& at(std::size_t i) {
    if (light_.empty()) light_.resize(static_cast<std::size_t>(longest_m / step_m));
    first_ = std::min(first_, i), last_ = std::max(last_, i + 1);
    return light_[i];
  }
  void add(double way_m, double light) {
    if (way_m < longest_m) at(static_cast<std::size_t>(way_m / step_m)) += light;
  }
  // Adds all light of `from`, multiplied by `share` and delayed by the path length `way_m`.
  void add(const ByLength& from, double way_m, double share) {
    const auto later = static_cast<std::size_t>(way_m / step_m + 0.5);
    if (from.first_ >= from.last_ || from.last_ + later > from.light_.size()) return;
    at(from.first_ + later), at(from.last_ + later - 1);
    for (std::size_t i = from.first_; i < from.last_; ++i)
      light_[i + later] += share * from.light_[i];
  }
  // Calls use(path length, light) for each bin that contains light.
  template <class Use>
  void for_each(Use use) const {
    for (std::size_t i = first_; i < last_; ++i)
      if (light_[i] > 0) use((static_cast<double>(i) + 0.5) * step_m, light_[i]);
  }

 private:
  std::vector<double> light_;
  std::size_t first_ = SIZE_MAX, last_ = 0;
};

class Walls {
 public:
  Walls(Patches lit, const Gaze& gaze, std::int64_t order)
      : gaze_(gaze), patches_(std::move(lit)), order_(order) {
    for (const Patch& p : patches_)
      light_.push_back(p.albedo * dimming(gaze, p) * p.cosine / (p.range_m * p.range_m));
    if (order_ < 2) return;
    again_.resize(patches_.size());
    for (std::size_t q = 0; q < patches_.size(); ++q)
      send(patches_[q], [&](std::size_t, double way_m, double light) {
        again_[q].add(way_m, patches_[q].albedo * light);
      });
  }

  // Adds the light returned by the patches `seen`. `ways` is 2 for bodies, because light takes each
  // path in both directions, and 1 for walls.
  void light(const Patches& seen, int ways, Returns& out) const {
    for (std::size_t k = 0; k < seen.size(); ++k) {
      const Patch& patch = seen[k];
      const double back = patch.albedo * patch.solid_angle_sr * dimming(gaze_, patch);
      const double extra_m = gaze_.extra_m + (ways > 1 ? gaze_.sway(k) : 0);
      const auto put = [&](double way_m, double weight) {
        out.range_m.push_back(way_m / 2 + extra_m);
        out.weight.push_back(weight / mean_scene_weight);
      };
      ByLength one_wall, two_walls;
      send(patch, [&](std::size_t p, double way_m, double light) {
        put(way_m + patch.range_m, ways * back * light);
        if (order_ < 2) return;
        one_wall.add(way_m, light);
        two_walls.add(again_[p], length(patch.at - patches_[p].at), light / light_[p]);
      });
      two_walls.for_each(
          [&](double way_m, double light) { put(way_m + patch.range_m, ways * back * light); });
      if (ways < 2) continue;
      ByLength both;  // light that travels out via one wall and back via a different wall
      one_wall.for_each([&](double there_m, double light) { both.add(one_wall, there_m, light); });
      both.for_each(
          [&](double way_m, double light) { put(way_m, patch.albedo * patch.area_m2() * light); });
    }
  }

 private:
  // Calls use(p, path length, light) for each wall patch p that illuminates `to`. The arguments are
  // the path length to `to` and the light received by `to`.
  template <class Use>
  void send(const Patch& to, Use use) const {
    for (std::size_t p = 0; p < patches_.size(); ++p)
      if (const double share = form_factor(to, patches_[p]); share > 0)
        use(p, patches_[p].range_m + length(to.at - patches_[p].at), share * light_[p]);
  }

  const Gaze& gaze_;
  Patches patches_;
  std::int64_t order_;
  std::vector<double> light_;    // exitance of each wall patch due to direct laser light
  std::vector<ByLength> again_;  // exitance of each wall patch due to light from other walls
};

}  // namespace

void add_light_by_walls(const Scene& scene, const Gaze& gaze, std::int64_t order, RoomReturns room,
                        Returns& returns, const PatchRays& rays) {
  if (!scene.room || order == 0) return;
  const Grid wall(gaze, rays.wall), body(gaze, rays.body);
  const Patches bodies = patches_of(scene, gaze.sensor_x_m, body.x, body.y);
  if (!bodies.empty()) Walls(lit_walls(scene, gaze, wall), gaze, order).light(bodies, 2, returns);
  if (room == RoomReturns::subtracted) return;
  const Patches walls = patches_of(*scene.room, gaze.sensor_x_m, wall.x, wall.y);
  Walls(walls, gaze, order).light(walls, 1, returns);
}

}  // namespace echofuse::sim
