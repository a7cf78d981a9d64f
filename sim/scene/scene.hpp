// SPDX-License-Identifier: MIT
// A scene stands in front of the sensors. It has capsules (people), flat plates made of strokes
// (letters, walls, faces of boxes) and triangles (a laboratory's own object).
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "acquire/measurement/letter.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/vec3.hpp"

namespace echofuse::sim {

inline constexpr double as_albedo = -1;

// A capsule holds all points within radius_m of the segment a-b.
struct Capsule {
  Vec3 a, b;
  double radius_m = 0, albedo = 0;
  double radar = as_albedo;  // the radar's reflectivity
};

using record::Stroke;

// A plate is the union of its strokes in the plane centre + u*U + v*V; U and V are orthonormal.
// Both sides reflect.
struct Plate {
  Vec3 centre, u, v;
  std::vector<Stroke> strokes;
  double albedo = 0;
  double radar = as_albedo;
};

struct Triangle {
  Vec3 a, b, c;
  double albedo = 0;
};

struct Room;  // room.hpp

struct Scene {
  std::vector<Capsule> capsules;
  std::vector<Plate> plates;
  std::vector<Triangle> triangles;
  const Room* room = nullptr;  // stands behind everything
  std::string label;           // person, letter:A, two_people, empty, object:chair
};

// reflector is a small white plate at reflector_m, straight ahead of the SPD or to its side
// (Conditions::reflector_before). object is the mesh of
// Conditions::object on the floor.
enum class SceneKind : std::uint8_t { person, letter, two_people, empty, reflector, object };
std::optional<SceneKind> kind_named(std::string_view name);
std::string kind_names();  // with commas between

// Kind of a scene, and place and turn of person, letter or object unless drawn at random.
struct SceneSpec {
  SceneKind kind = SceneKind::empty;
  std::optional<double> x_m{}, z_m{}, yaw_deg{};

  SceneSpec() = default;
  SceneSpec(SceneKind k) : kind(k) {}  // NOLINT: a kind alone is a specification
  bool operator==(const SceneSpec&) const = default;
};

// Scene `index` of `seed` is the same whatever was made before and on whichever thread.
Scene make_scene(const Conditions& conditions, const SceneSpec& spec, std::uint64_t seed,
                 std::uint64_t index);

// The first is true if a reflectivity is not the albedo. The second is the scene with the
// reflectivities as albedos.
bool radar_sees_apart(const Scene& scene);
Scene as_radar_sees(Scene scene);

}  // namespace echofuse::sim
