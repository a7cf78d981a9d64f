// SPDX-License-Identifier: MIT
// Triangle meshes of a laboratory's own objects, read from files.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/vec3.hpp"

namespace echofuse::sim {

struct Mesh {
  std::vector<Vec3> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // without triangles of zero area
};

// Reads Wavefront OBJ: v and f; polygons become triangle fans, other lines are ignored. `name` is
// used in messages. Throws Error(config) with one line: NAME:line, found and expected text.
Mesh read_mesh(const std::string& text, const std::string& name);

// Reads the mesh of a file once. Threading: any thread.
const Mesh& mesh_of(const std::string& path);

}  // namespace echofuse::sim
