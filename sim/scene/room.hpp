// SPDX-License-Identifier: MIT
// Static rooms behind the people. One is the fixed background of the single-sensor baseline (Turpin
// et al., Optica 7, 900, 2020); the others test a model in a new room.
#pragma once
#include <string>
#include <vector>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

struct Room {
  std::string name;
  std::vector<Plate> plates;
  // The first `walls` plates are walls, floor and ceiling, which reflect radar waves specularly.
  // The rest are faces of boxes.
  std::size_t walls = 0;
};

// "room": two slanted walls and four boxes behind the people, all at z > 4.6 m and within 7.0 m
// slant range over the base field of view. Left and right differ in range everywhere, so the range
// of the occluded light indicates the person's direction.
// "moved": its boxes at other positions. "door": an open door in its right wall, with a wall 1 m
// behind. "bystander": a motionless person at its left wall. "other": other walls, boxes and
// colours.
// "closed": walls and boxes of "room" between side walls at x = -2.2 and 2.9 m, with floor and
// ceiling. "corridor": walls at x = -1.25 and 0.95 m, floor and ceiling, without an end. These two
// have multipath by the sides (multipath_order).
const std::vector<Room>& rooms();
const Room& room();
const Room* room_named(const std::string& background);  // nullptr: none, or unknown
std::vector<std::string> room_names();                  // "none" first
Scene empty_room(const Room& of = room());

}  // namespace echofuse::sim
