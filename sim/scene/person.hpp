// SPDX-License-Identifier: MIT
// People of 16 capsules, alone or holding a letter.
#pragma once
#include <cstdint>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

class SceneSampler;

// Where somebody stands and which way he faces: yaw 0 is towards -z, positive turns to +x.
struct Stand {
  double x_m = 0, z_m = 0, yaw_rad = 0;
};

inline constexpr std::int32_t capsules_of_person = 16;

// Height, build, clothes and reflectivities as the conditions say, a random pose.
void add_person(Scene& scene, const Conditions& conditions, const Stand& stand,
                SceneSampler& sampler);

// The same, with a flat letter held in both hands at arm's length, facing where the person faces.
// Of either size (acquire/record/letter.hpp) times letter_scale. Returns the letter.
char add_letter_person(Scene& scene, const Conditions& conditions, const Stand& stand,
                       SceneSampler& sampler);

}  // namespace echofuse::sim
