// SPDX-License-Identifier: MIT
// A TOML file lists scenes one by one:
//   [[scene]]
//   kind = "person"     # person, letter, two_people, empty, reflector, object
//   count = 3           # so many of these in a row; 1 if not given
//   x_m = 0.5           # where it stands and turns; random if not given
//   z_m = 3.5
//   yaw_deg = 20
#pragma once
#include <string>
#include <vector>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Throws Error(config) that lists every fault as NAME:line:column: the fault.
std::vector<SceneSpec> read_scene_list(const std::string& text, const std::string& name);

}  // namespace echofuse::sim
