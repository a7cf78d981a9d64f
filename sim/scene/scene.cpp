// SPDX-License-Identifier: MIT
#include "sim/scene/scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "sim/scene/draw.hpp"
#include "sim/scene/mesh.hpp"
#include "sim/scene/person.hpp"
#include "sim/scene/room.hpp"

namespace echofuse::sim {
namespace {

constexpr std::array kinds{"person", "letter", "two_people", "empty", "reflector", "object"};

Stand random_place(const Conditions& c, Rng& rng) {
  const double x = uniform(rng, -c.target_x_m, c.target_x_m);
  return {x, uniform(rng, c.target_z_min_m, c.target_z_max_m), 0};
}

double random_turn(double max_deg, Rng& rng) {
  return uniform(rng, -max_deg, max_deg) * std::numbers::pi / 180;
}

// Replaces a random position and yaw with the values given in `spec`. The random values are always
// drawn, so that later random numbers do not depend on `spec`.
Stand chosen(const SceneSpec& spec, Stand random) {
  const double degree = std::numbers::pi / 180;
  return {spec.x_m.value_or(random.x_m), spec.z_m.value_or(random.z_m),
          spec.yaw_deg ? *spec.yaw_deg * degree : random.yaw_rad};
}

Stand random_stand(const Conditions& c, double max_yaw_deg, Rng& rng) {
  Stand stand = random_place(c, rng);
  stand.yaw_rad = random_turn(max_yaw_deg, rng);
  return stand;
}

void add_letter(Scene& scene, const Conditions& c, const SceneSpec& spec, Rng& rng) {
  Stand stand = random_place(c, rng);
  const double towards_sensors = std::atan2(-stand.x_m, stand.z_m);
  stand.yaw_rad = towards_sensors + random_turn(c.letter_yaw_deg, rng);
  stand = chosen(spec, stand);
  scene.label = std::string(record::letter_label) + add_letter_person(scene, c, stand, rng);
}

// Adds two people side by side, one in each half of the allowed width.
void add_two(Scene& scene, const Conditions& c, Rng& rng) {
  for (const double side : {-0.5, 0.5}) {
    Stand stand = random_stand(c, c.person_yaw_deg, rng);
    stand.x_m = stand.x_m / 2 + side * c.target_x_m;
    add_person(scene, c, stand, rng);
  }
  scene.label = "two_people";
}

constexpr double object_albedo = 0.5;

// Adds the mesh. The centre of its floor plan is at the position in `stand`, and its lowest point
// is on the floor.
void add_object(Scene& scene, const Conditions& c, const Stand& stand) {
  const Mesh& mesh = mesh_of(c.object);
  // Mesh coordinates are right-handed. Scene coordinates are left-handed: x right, y up, z away
  // from the sensors.
  const auto upright = [&](Vec3 p) {
    return c.object_up == "z"    ? Vec3{p.x, p.z, p.y}
           : c.object_up == "-y" ? Vec3{p.x, -p.y, p.z}
                                 : Vec3{p.x, p.y, -p.z};
  };
  Vec3 low{INFINITY, INFINITY, INFINITY}, high = -1 * low;
  for (const auto& corners : mesh.triangles)
    for (const auto corner : corners) {
      const Vec3 p = upright(mesh.points[corner]);
      low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
  const Vec3 foot{(low.x + high.x) / 2, low.y, (low.z + high.z) / 2};
  const double cosine = std::cos(stand.yaw_rad), sine = std::sin(stand.yaw_rad);
  const auto world = [&](std::uint32_t corner) {
    const Vec3 p = c.object_scale * (upright(mesh.points[corner]) - foot);
    // Rotates the mesh with the sign convention of people: yaw 0 faces the sensors, and positive
    // yaw turns towards +x.
    return Vec3{stand.x_m + cosine * p.x - sine * p.z, p.y - c.camera_height_m,
                stand.z_m + sine * p.x + cosine * p.z};
  };
  for (const auto& [i, j, k] : mesh.triangles)
    scene.triangles.push_back({world(i), world(j), world(k), object_albedo});
  scene.label = "object:" + std::filesystem::path(c.object).stem().string();
}

}  // namespace

std::optional<SceneKind> kind_named(std::string_view name) {
  const auto found = std::find(kinds.begin(), kinds.end(), name);
  if (found == kinds.end()) return {};
  return static_cast<SceneKind>(found - kinds.begin());
}

std::string kind_names() {
  std::string all;
  for (const char* name : kinds) all += (all.empty() ? "" : ", ") + std::string(name);
  return all;
}

Scene make_scene(const Conditions& c, const SceneSpec& spec, std::uint64_t seed,
                 std::uint64_t index) {
  Rng rng = make_rng(seed, index);
  Scene scene;
  scene.room = room_named(c.background);
  switch (spec.kind) {
    case SceneKind::person:
      add_person(scene, c, chosen(spec, random_stand(c, c.person_yaw_deg, rng)), rng);
      scene.label = "person";
      break;
    case SceneKind::letter:
      add_letter(scene, c, spec, rng);
      break;
    case SceneKind::two_people:
      add_two(scene, c, rng);
      break;
    case SceneKind::empty:
      scene.label = "empty";
      break;
    case SceneKind::reflector: {
      // The plate is so small that its edges are at most 0.02 mm farther away per metre than its
      // centre. Its signal at 1 m equals that of the mean scene.
      const double z_m = c.reflector_z_m, half = 0.006 * z_m;
      const double x_m = c.reflector_before == "right"  ? c.baseline_m
                         : c.reflector_before == "left" ? -c.baseline_m
                                                        : 0;
      scene.plates.push_back(
          {{x_m, 0, z_m}, {1, 0, 0}, {0, 1, 0}, {{-half, 0, half, 0, 2 * half}}, 11});
      scene.room = nullptr;
      scene.label = "reflector";
      break;
    }
    case SceneKind::object:
      add_object(scene, c, chosen(spec, random_stand(c, 180, rng)));
      break;
  }
  return scene;
}

bool radar_sees_apart(const Scene& scene) {
  const auto apart = [](const auto& shape) {
    return shape.radar != as_albedo && shape.radar != shape.albedo;
  };
  return std::any_of(scene.capsules.begin(), scene.capsules.end(), apart) ||
         std::any_of(scene.plates.begin(), scene.plates.end(), apart);
}

Scene as_radar_sees(Scene scene) {
  const auto see = [](auto& shapes) {
    for (auto& shape : shapes)
      if (shape.radar != as_albedo) shape.albedo = shape.radar;
  };
  see(scene.capsules);
  see(scene.plates);
  return scene;
}

}  // namespace echofuse::sim
