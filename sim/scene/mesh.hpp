// SPDX-License-Identifier: MIT
// Triangle meshes of objects that users provide as files.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/vec3.hpp"

namespace echofuse::sim {

struct Mesh {
  std::vector<Vec3> points;
  // zero-based vertex indices; no triangle has zero area
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

// Reads a mesh in Wavefront OBJ format. Reads vertices (v) and faces (f), splits polygons into
// triangle fans, and ignores other lines. `name` is used in messages. Throws Error(config) with
// NAME:line, the text found and the text expected; a concave face is an error.
Mesh read_mesh(const std::string& text, const std::string& name);

// Returns the extent of the triangles along the axes of the file.
Vec3 size_of(const Mesh& mesh);

// Returns the mesh stored in the file. The file is read only once, on the first call. Threading:
// may be called from any thread.
const Mesh& mesh_of(const std::string& path);

}  // namespace echofuse::sim
