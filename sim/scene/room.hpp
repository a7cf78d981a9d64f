// SPDX-License-Identifier: MIT
// The fixed background of the single-sensor baseline (Turpin et al., Optica 7, 900, 2020).
#pragma once
#include <vector>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

// Two slanted walls and four boxes behind the people, all at z > 4.6 m and within 7.0 m slant range
// over the base field of view. Left and right differ in range everywhere, so the range of the light
// that a person takes away tells the person's direction.
const std::vector<Plate>& room();
Scene empty_room();

}  // namespace echofuse::sim
