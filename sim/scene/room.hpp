// SPDX-License-Identifier: MIT
// A room stands still behind people. One is the fixed background of the single-sensor baseline
// (Turpin et al., Optica 7, 900, 2020); a model can be taken to the others.
#pragma once
#include <string>
#include <vector>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

struct Room {
  std::string name;
  std::vector<Plate> plates;
  // The first `walls` plates are walls, floor and ceiling, which mirror a radar's echoes. The rest
  // are faces of boxes.
  std::size_t walls = 0;
};

// "room" has two slanted walls and four boxes behind the people, all at z > 4.6 m and within 7.0 m
// slant range over the base field of view. Left and right differ in range everywhere, so the range
// of the light that a person takes away tells the person's direction.
// In "moved" its boxes stand elsewhere. In "door" a door in its right wall is open, on a wall 1 m
// behind. In "bystander" a person stands still at its left wall. "other" has other walls, boxes and
// colours.
// "closed" has the walls and boxes of "room" between side walls at x = -2.2 and 2.9 m, with floor
// and ceiling. "corridor" has walls at x = -1.25 and 0.95 m, floor and ceiling, without an end. In
// these two waves come back by the sides (multipath_order).
const std::vector<Room>& rooms();
const Room& room();
const Room* room_named(const std::string& background);  // nullptr: none, or unknown
std::vector<std::string> room_names();                  // "none" first
Scene empty_room(const Room& of = room());

}  // namespace echofuse::sim
