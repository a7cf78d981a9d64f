// SPDX-License-Identifier: MIT
// Triangle meshes come from files: they are a laboratory's own objects.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/vec3.hpp"

namespace echofuse::sim {

struct Mesh {
  std::vector<Vec3> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // without those that have no area
};

// Reads Wavefront OBJ: v and f; polygons become fans, everything else is passed over. `name` stands
// in messages. Throws Error(config) with one line: NAME:line, what was found and what was expected.
Mesh read_mesh(const std::string& text, const std::string& name);

// Reads the mesh in a file once. Threading: any thread may call it.
const Mesh& mesh_of(const std::string& path);

}  // namespace echofuse::sim
