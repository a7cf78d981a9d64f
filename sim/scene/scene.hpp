// SPDX-License-Identifier: MIT
// Scene in front of the sensors: capsules (people), flat plates made of strokes (letters, walls,
// faces of boxes) and triangles (a laboratory's own object).
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

// Capsule: all points within radius_m of the segment a-b.
struct Capsule {
  Vec3 a, b;
  double radius_m = 0, albedo = 0;
  double radar = as_albedo;  // reflectivity for the radar
};

using record::Stroke;

// Plate: union of its strokes in the plane centre + u*U + v*V, with orthonormal U and V. Reflects
// on both sides.
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

struct Room;  // declared in room.hpp

struct Scene {
  std::vector<Capsule> capsules;
  std::vector<Plate> plates;
  std::vector<Triangle> triangles;
  const Room* room = nullptr;  // behind everything else
  std::string label;           // person, letter:A, two_people, empty, object:chair
};

// reflector: small white plate at reflector_m, in front of the SPD or to its side
// (Conditions::reflector_before). object: mesh of Conditions::object on the floor.
enum class SceneKind : std::uint8_t { person, letter, two_people, empty, reflector, object };
std::optional<SceneKind> kind_named(std::string_view name);
std::string kind_names();  // separated by commas

// Kind of a scene, with place and yaw of the person, letter or object; random if not given.
struct SceneSpec {
  SceneKind kind = SceneKind::empty;
  std::optional<double> x_m{}, z_m{}, yaw_deg{};

  SceneSpec() = default;
  SceneSpec(SceneKind k) : kind(k) {}  // NOLINT: implicit, because a kind alone is a specification
  bool operator==(const SceneSpec&) const = default;
};

// Scene `index` of `seed` does not depend on other scenes or on the thread.
Scene make_scene(const Conditions& conditions, const SceneSpec& spec, std::uint64_t seed,
                 std::uint64_t index);

// radar_sees_apart() is true if a reflectivity differs from the albedo. as_radar_sees() returns the
// scene with the radar reflectivities as albedos.
bool radar_sees_apart(const Scene& scene);
Scene as_radar_sees(Scene scene);

}  // namespace echofuse::sim
