// SPDX-License-Identifier: MIT
// People consist of 16 capsules; they stand alone or hold a letter.
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

// Height, build, clothes and reflectivities follow the conditions; the pose is random.
void add_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng);

// Adds a person with a flat letter held in both hands at arm's length, facing where the person
// faces. Its size is one of acquire/measurement/letter.hpp times letter_scale. Returns the letter.
char add_letter_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng);

}  // namespace echofuse::sim
