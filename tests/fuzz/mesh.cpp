// SPDX-License-Identifier: MIT
// Input: an OBJ file.
#include "sim/scene/mesh.hpp"

#include <cmath>

#include "fuzz.hpp"

void fuzz::run(ByteView input) {
  faults_by("x.mesh:", [&] {
    const sim::Mesh mesh = sim::read_mesh(std::string(text_of(input)), "x.mesh");
    require(!mesh.triangles.empty(), "a mesh has triangles");
    for (const sim::Vec3& p : mesh.points)
      require(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z), "points are finite");
    for (const auto& corners : mesh.triangles)
      for (const std::uint32_t corner : corners)
        require(corner < mesh.points.size(), "a corner refers to a point");
  });
}
