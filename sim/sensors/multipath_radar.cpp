// SPDX-License-Identifier: MIT
#include "sim/sensors/multipath_radar.hpp"

#include <algorithm>
#include <cmath>

#include "sim/scene/room.hpp"
#include "sim/sensors/gaze.hpp"
#include "sim/sensors/multipath_patches.hpp"

namespace echofuse::sim {
namespace {

Vec3 normal_of(const Plate& wall) { return cross(wall.u, wall.v); }

Vec3 mirrored_at(const Plate& wall, Vec3 p) {
  const Vec3 n = normal_of(wall);
  return p - 2 * dot(n, p - wall.centre) * n;
}

// Returns true if p, a point in the plane of the wall, is on the wall. A wall consists of one
// stroke.
bool on_wall(const Plate& wall, Vec3 p) {
  const Stroke& s = wall.strokes.front();
  const double along_u = dot(p - wall.centre, wall.u) - s.u0;
  const double along_v = dot(p - wall.centre, wall.v) - s.v0;
  const double du = s.u1 - s.u0, dv = s.v1 - s.v0, reach = std::hypot(du, dv);
  const double along = (along_u * du + along_v * dv) / reach;
  const double across = (along_v * du - along_u * dv) / reach;
  return along >= 0 && along <= reach && std::abs(across) <= s.width_m / 2;
}

// Returns the point where the line segment between the two points crosses the wall; empty if the
// segment does not cross the wall.
std::optional<Vec3> through(const Plate& wall, Vec3 from, Vec3 to) {
  const Vec3 n = normal_of(wall);
  const double before = dot(n, from - wall.centre), behind = dot(n, to - wall.centre);
  if (before * behind >= 0) return std::nullopt;
  const Vec3 at = from + (before / (before - behind)) * (to - from);
  if (!on_wall(wall, at)) return std::nullopt;
  return at;
}

// One path to a patch: the factor by which it multiplies the power of the echo, its length, its
// direction at the radar, and its number of reflections.
struct Arrival {
  double share, length_m;
  Vec3 departure;
  int reflections;
};

class Echoes {
 public:
  Echoes(const Scene& scene, const Conditions& c, const Gaze& gaze, Returns& returns)
      : c_(c),
        gaze_(gaze),
        sensor_{gaze.sensor_x_m, 0, 0},
        images_(image_sources(*scene.room, sensor_, static_cast<int>(c.multipath_order))),
        capsules_(static_cast<std::int32_t>(scene.capsules.size())),
        scene_(scene),
        returns_(returns) {}

  void add(const Patch& patch) {
    arrive(patch);
    const double echo = patch.albedo * patch.area_m2() / mean_scene_weight;
    for (std::size_t i = 0; i < ways_.size(); ++i)
      for (std::size_t j = i; j < ways_.size(); ++j) {
        const int reflections = ways_[i].reflections + ways_[j].reflections;
        if (reflections == 0 || reflections > c_.multipath_order) continue;
        put(patch, ways_[i], ways_[j], (i == j ? 1 : 4) * echo * ways_[i].share * ways_[j].share);
      }
  }

 private:
  void arrive(const Patch& patch) {
    const double n = patch.shape < capsules_ ? gaze_.lobe : gaze_.plate_lobe;
    ways_.clear();
    for (const ImageSource& image : images_) {
      const auto way = way_to(image, sensor_, sensor_ + patch.at);
      if (!way || way->departure.z <= 0) continue;
      const double cosine = -dot(patch.normal, way->arrival);
      if (cosine <= 0) continue;
      double share = cosine / (way->length_m * way->length_m);
      for (int k = 0; k < image.reflections; ++k) share *= c_.radar_wall_reflectivity;
      if (n != 1) share *= std::sqrt((n + 2) / 3) * std::pow(std::max(cosine, 1e-6), (n - 1) / 2);
      ways_.push_back(
          {share * gain(way->departure), way->length_m, way->departure, image.reflections});
    }
  }

  double gain(Vec3 departure) const {
    if (gaze_.falloff <= 0) return 1;
    const double dx = departure.x / departure.z - gaze_.middle_x;
    const double dy = departure.y / departure.z;
    return std::exp(-gaze_.falloff * (dx * dx + dy * dy) /
                    (2 * gaze_.half_tangent * gaze_.half_tangent));
  }

  void put(const Patch& patch, const Arrival& there, const Arrival& back, double weight) {
    returns_.range_m.push_back((there.length_m + back.length_m) / 2 + gaze_.extra_m);
    returns_.weight.push_back(weight);
    if (!gaze_.height_m) return;
    const Vec3 from = 0.5 * (there.departure + back.departure);
    returns_.place.push_back({static_cast<float>(from.x), static_cast<float>(from.y),
                              static_cast<float>(patch.at.y + *gaze_.height_m),
                              person_of(scene_, patch.shape)});
  }

  const Conditions& c_;
  const Gaze& gaze_;
  Vec3 sensor_;
  std::vector<ImageSource> images_;
  std::int32_t capsules_;
  const Scene& scene_;
  Returns& returns_;
  std::vector<Arrival> ways_;  // paths to the current patch
};

}  // namespace

std::vector<ImageSource> image_sources(const Room& room, Vec3 sensor, int order) {
  std::vector<ImageSource> out{{sensor, {}, 0}};
  const auto end = room.plates.begin() + static_cast<std::ptrdiff_t>(room.walls);
  for (auto first = room.plates.begin(); order > 0 && first != end; ++first) {
    const Vec3 image = mirrored_at(*first, sensor);
    out.push_back({image, {&*first}, 1});
    for (auto second = room.plates.begin(); order > 1 && second != end; ++second)
      if (second != first) out.push_back({mirrored_at(*second, image), {&*first, &*second}, 2});
  }
  return out;
}

std::optional<Way> way_to(const ImageSource& image, Vec3 sensor, Vec3 place) {
  const Vec3 whole = place - image.at;
  const double long_m = length(whole);
  // Current point of the path, which is traced back from `place` to the sensor.
  Vec3 met = place;
  if (image.reflections == 2) {
    const auto second = through(*image.walls[1], image.at, place);
    if (!second) return std::nullopt;
    met = *second;
  }
  if (image.reflections > 0) {
    const auto first = through(*image.walls[0], mirrored_at(*image.walls[0], sensor), met);
    if (!first) return std::nullopt;
    met = *first;
  }
  const Vec3 leaves = met - sensor;
  return Way{(1 / length(leaves)) * leaves, (1 / long_m) * whole, long_m};
}

void add_echoes_by_walls(const Scene& scene, const Conditions& c, const Gaze& gaze, const Axis& x,
                         const Axis& y, Returns& returns) {
  if (!scene.room || c.multipath_order == 0) return;
  Echoes echoes(scene, c, gaze, returns);
  for (const Patch& patch : patches_of(scene, gaze.sensor_x_m, x, y)) echoes.add(patch);
}

}  // namespace echofuse::sim
