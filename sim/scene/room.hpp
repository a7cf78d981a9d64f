// SPDX-License-Identifier: MIT
// Static rooms behind the people. The first room is the fixed background of the single-sensor
// baseline (Turpin et al., Optica 7, 900, 2020). The other rooms are used to test a model in a room
// that is not in its training data.
#pragma once
#include <string>
#include <vector>

#include "sim/scene/scene.hpp"

namespace echofuse::sim {

struct Room {
  std::string name;
  std::vector<Plate> plates;
  // The first `walls` plates are the walls, the floor and the ceiling, which reflect radar waves
  // specularly. The other plates are faces of boxes.
  std::size_t walls = 0;
};

// Returns all rooms:
//   room       two slanted walls and four boxes behind the people, at z > 4.6 m
//   moved      as room, but the boxes are at other positions
//   door       as room, but the right wall has an open door, with a wall 1 m behind it
//   bystander  as room, but a motionless person is at the left wall
//   other      walls, boxes and albedos that differ from those of room
//   closed     as room, but with side walls at x = -2.2 and 2.9 m, floor and ceiling
//   corridor   side walls at x = -1.25 and 0.95 m, floor and ceiling, without end walls
// All surfaces of `room` in the default field of view are within 7.0 m slant range. The left and
// right halves of `room` differ in range everywhere, so the range of occluded light indicates the
// direction of the person. Only `closed` and `corridor` have notable multipath (multipath_order).
const std::vector<Room>& rooms();
const Room& room();
// Returns nullptr if the name is "none" or unknown.
const Room* room_named(const std::string& background);
// Returns "none" and the names of all rooms.
std::vector<std::string> room_names();
Scene empty_room(const Room& of = room());

}  // namespace echofuse::sim
