// SPDX-License-Identifier: MIT
// TOML list of scenes:
//   [[scene]]
//   kind = "person"     # person, letter, two_people, empty, reflector, object
//   count = 3           # number of consecutive records; default 1
//   x_m = 0.5           # position and yaw; random if not given
//   z_m = 3.5
//   yaw_deg = 20
#pragma once
#include <string>
#include <vector>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Reads a scene list. Throws Error(config) with all mistakes, each on a line of the form
// "NAME:line:column: mistake".
std::vector<SceneSpec> read_scene_list(const std::string& text, const std::string& name);

}  // namespace echofuse::sim
