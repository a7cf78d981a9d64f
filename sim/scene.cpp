// SPDX-License-Identifier: MIT
#include "sim/scene.hpp"

#include <cmath>
#include <numbers>

#include "sim/draw.hpp"
#include "sim/person.hpp"

namespace echofuse::sim {
namespace {

Stand random_place(const Conditions& c, Rng& rng) {
  const double x = uniform(rng, -c.target_x_m, c.target_x_m);
  return {x, uniform(rng, c.target_z_min_m, c.target_z_max_m), 0};
}

double random_turn(double most_deg, Rng& rng) {
  return uniform(rng, -most_deg, most_deg) * std::numbers::pi / 180;
}

Stand random_stand(const Conditions& c, Rng& rng) {
  Stand stand = random_place(c, rng);
  stand.yaw_rad = random_turn(c.person_yaw_deg, rng);
  return stand;
}

void add_letter(Scene& scene, const Conditions& c, Rng& rng) {
  Stand stand = random_place(c, rng);
  const double towards_sensors = std::atan2(-stand.x_m, stand.z_m);
  stand.yaw_rad = towards_sensors + random_turn(c.letter_yaw_deg, rng);
  scene.label = std::string("letter:") + add_letter_person(scene, c, stand, rng);
}

// Half of the width each: they stand side by side.
void add_two(Scene& scene, const Conditions& c, Rng& rng) {
  for (const double side : {-0.5, 0.5}) {
    Stand stand = random_stand(c, rng);
    stand.x_m = stand.x_m / 2 + side * c.target_x_m;
    add_person(scene, c, stand, rng);
  }
  scene.label = "two_people";
}

Vec3 flipped(Vec3 p) { return {-p.x, p.y, p.z}; }

}  // namespace

Scene make_scene(const Conditions& c, SceneKind kind, std::uint64_t seed, std::uint64_t index) {
  Rng rng = make_rng(seed, index);
  Scene scene;
  scene.room = c.background == "room";
  switch (kind) {
    case SceneKind::person:
      add_person(scene, c, random_stand(c, rng), rng);
      scene.label = "person";
      break;
    case SceneKind::letter:
      add_letter(scene, c, rng);
      break;
    case SceneKind::two_people:
      add_two(scene, c, rng);
      break;
    case SceneKind::empty:
      scene.label = "empty";
      break;
    case SceneKind::reflector: {
      // So small that its edges are no farther than its middle by 0.02 mm, at 1 m; there as bright
      // as the mean scene.
      const double half = 0.006 * c.reflector_m;
      scene.plates.push_back(
          {{0, 0, c.reflector_m}, {1, 0, 0}, {0, 1, 0}, {{-half, 0, half, 0, 2 * half}}, 11});
      scene.room = false;
      scene.label = "reflector";
      break;
    }
  }
  return scene;
}

Scene mirrored(const Scene& scene) {
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

}  // namespace echofuse::sim
