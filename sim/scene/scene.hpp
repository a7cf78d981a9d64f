// SPDX-License-Identifier: MIT
// Scene in front of the sensors. It consists of capsules (people), flat plates made of strokes
// (letters, walls and faces of boxes), and triangles (meshes that users provide).
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

// Special value: the radar reflectivity equals the albedo.
inline constexpr double as_albedo = -1;

// Capsule: all points within `radius_m` of the segment a-b.
struct Capsule {
  Vec3 a, b;
  double radius_m = 0, albedo = 0;
  double radar = as_albedo;  // radar reflectivity; as_albedo: equal to `albedo`
};

using record::Stroke;

// Plate: union of its strokes. A point (a, b) of a stroke is at centre + a*u + b*v, where the unit
// vectors u and v are orthogonal. Both sides reflect.
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

struct Room;  // defined in room.hpp

struct Scene {
  std::vector<Capsule> capsules;
  std::vector<Plate> plates;
  std::vector<Triangle> triangles;
  const Room* room = nullptr;  // room behind all shapes, or nullptr
  std::string label;           // for example person, letter:A, two_people, empty, object:chair
};

// A reflector is a small plate at z = Conditions::reflector_z_m, in front of the SPD or to the left
// or right of it (Conditions::reflector_before). An object is the mesh Conditions::object on the
// floor.
enum class SceneKind : std::uint8_t { person, letter, two_people, empty, reflector, object };
std::optional<SceneKind> kind_named(std::string_view name);
std::string kind_names();  // Returns the names of all kinds, separated by commas.

// Kind of a scene, and the position and yaw of its person, letter or object. Unspecified values are
// random.
struct SceneSpec {
  SceneKind kind = SceneKind::empty;
  std::optional<double> x_m{}, z_m{}, yaw_deg{};

  SceneSpec() = default;
  SceneSpec(SceneKind k) : kind(k) {}  // NOLINT: implicit, because a kind alone is a specification
  bool operator==(const SceneSpec&) const = default;
};

// Returns scene number `index` for this seed. The result does not depend on other scenes or on the
// thread.
Scene make_scene(const Conditions& conditions, const SceneSpec& spec, std::uint64_t seed,
                 std::uint64_t index);

// radar_sees_apart() returns true if the radar reflectivity of a shape differs from its albedo.
// as_radar_sees() returns the scene with each albedo replaced by the radar reflectivity.
bool radar_sees_apart(const Scene& scene);
Scene as_radar_sees(Scene scene);

}  // namespace echofuse::sim
