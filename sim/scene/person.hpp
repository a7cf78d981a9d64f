// SPDX-License-Identifier: MIT
// People as 16 capsules, alone or with a letter.
#pragma once
#include <cstdint>

#include "drivers/core/random.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Place and direction of a person: yaw 0 faces -z (the sensors), positive yaw turns to +x.
struct Stand {
  double x_m = 0, z_m = 0, yaw_rad = 0;
};

inline constexpr std::int32_t capsules_of_person = 16;

// Adds a person with height, build, clothes and reflectivity from the conditions, and a random
// pose.
void add_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng);

// Adds a person who holds a flat letter in both hands at arm's length, facing the same direction.
// The size is one of acquire/measurement/letter.hpp times letter_scale. Returns the letter.
char add_letter_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng);

}  // namespace echofuse::sim
