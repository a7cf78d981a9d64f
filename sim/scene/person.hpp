// SPDX-License-Identifier: MIT
// Adds people to a scene. A person consists of 16 capsules and may hold a letter.
#pragma once
#include <cstdint>

#include "drivers/core/random.hpp"
#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Position and direction of a person. At yaw 0 the person faces the sensors (-z); positive yaw
// turns towards +x.
struct Stand {
  double x_m = 0, z_m = 0, yaw_rad = 0;
};

inline constexpr std::int32_t capsules_of_person = 16;

// Adds a person with a random pose. The conditions contain the ranges of height, build, clothes and
// reflectivity.
void add_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng);

// Adds a person who holds a flat letter in both hands at arm's length. The letter faces in the same
// direction as the person. The letter and its size are random (acquire/measurement/letter.hpp);
// `letter_scale` and `target_scale` multiply the size. Returns the letter.
char add_letter_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng);

}  // namespace echofuse::sim
