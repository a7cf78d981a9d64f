// SPDX-License-Identifier: MIT
// What stands in front of the sensors: capsules (people) and flat plates made of strokes (letters,
// walls, faces of boxes).
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "sim/conditions.hpp"
#include "sim/vec3.hpp"

namespace echofuse::sim {

// All points within radius_m of the segment a-b.
struct Capsule {
  Vec3 a, b;
  double radius_m = 0, albedo = 0;
};

// A band of the given width about the segment (u0, v0)-(u1, v1), its ends cut square. Metres.
struct Stroke {
  double u0 = 0, v0 = 0, u1 = 0, v1 = 0, width_m = 0;
};

// The union of its strokes in the plane centre + u*U + v*V; U, V orthonormal. Both sides reflect.
struct Plate {
  Vec3 centre, u, v;
  std::vector<Stroke> strokes;
  double albedo = 0;
};

struct Triangle {
  Vec3 a, b, c;
  double albedo = 0;
};

struct Scene {
  std::vector<Capsule> capsules;
  std::vector<Plate> plates;
  std::vector<Triangle> triangles;
  bool room = false;  // the fixed room stands behind everything
  std::string label;  // person, letter:A, two_people, empty
};

// reflector: a small white plate at reflector_m straight ahead of the SPD.
enum class SceneKind : std::uint8_t { person, letter, two_people, empty, reflector };

// Scene `index` of `seed`: the same whatever was made before and on whichever thread.
Scene make_scene(const Conditions& conditions, SceneKind kind, std::uint64_t seed,
                 std::uint64_t index);

// x -> -x of people and plates. The room stays where it is.
Scene mirrored(const Scene& scene);

}  // namespace echofuse::sim
