// SPDX-License-Identifier: MIT
// Small scenes with known geometry.
#pragma once
#include <cmath>
#include <numeric>

#include "sim/scene/scene.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

inline Capsule sphere(Vec3 centre, double radius_m, double albedo = 0.5) {
  return {centre, centre, radius_m, albedo};
}

// Returns a wall at a distance of z_m. The wall fills the field of view.
inline Plate screen(double z_m, double albedo) {
  return {{0, 0, z_m}, {1, 0, 0}, {0, 1, 0}, {{-100, 0, 100, 0, 200}}, albedo};
}

inline double total(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

// Expected value and variance of the counts in each bin if only the first photon of a pulse counts.
struct FirstPhotons {
  std::vector<double> mean, variance;
};
inline FirstPhotons first_photons(const std::vector<double>& rate, double pulses) {
  FirstPhotons out;
  double before = 0;
  for (const double r : rate) {
    const double p = std::exp(-before) * -std::expm1(-r / pulses);
    before += r / pulses;
    out.mean.push_back(pulses * p);
    out.variance.push_back(pulses * p * (1 - p));
  }
  return out;
}

// Returns a mirrored copy (x -> -x) of the scene with its people and plates. The room is not
// mirrored.
inline Scene mirrored(const Scene& scene) {
  const auto flipped = [](Vec3 p) { return Vec3{-p.x, p.y, p.z}; };
  Scene image = scene;
  for (auto& capsule : image.capsules) {
    capsule.a = flipped(capsule.a);
    capsule.b = flipped(capsule.b);
  }
  for (auto& plate : image.plates) {
    plate.centre = flipped(plate.centre);
    plate.u = flipped(plate.u);
    plate.v = flipped(plate.v);
  }
  for (auto& t : image.triangles) t = {flipped(t.a), flipped(t.b), flipped(t.c), t.albedo};
  return image;
}

// Returns a scene that shows a person if `index` is even, and a person with a letter if `index` is
// odd.
inline Scene some_scene(const Conditions& conditions, std::uint64_t index) {
  return make_scene(conditions, index % 2 ? SceneKind::letter : SceneKind::person, 42, index);
}

}  // namespace echofuse::sim
