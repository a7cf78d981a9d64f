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

// Height 1.55-1.90 m, albedo 0.3-0.7, a random pose.
void add_person(Scene& scene, const Conditions& conditions, const Stand& stand,
                SceneSampler& sampler);

// The same, with a flat letter held in both hands at arm's length, facing where the person faces.
// Of either size (acquire/record/letter.hpp), albedo 0.8. Returns the letter.
char add_letter_person(Scene& scene, const Conditions& conditions, const Stand& stand,
                       SceneSampler& sampler);

}  // namespace echofuse::sim
