// SPDX-License-Identifier: MIT
#include "sim/scene/room.hpp"

#include <algorithm>

namespace echofuse::sim {
namespace {

constexpr double floor_y_m = -1.1, ceiling_y_m = 1.5;
constexpr Vec3 up{0, 1, 0};

Plate rectangle(Vec3 centre, Vec3 u, Vec3 v, double width_m, double height_m, double albedo) {
  return {centre, u, v, {{-width_m / 2, 0, width_m / 2, 0, height_m}}, albedo};
}

// Returns an upright wall from (x0, z0) to (x1, z1). Its height of 7 m exceeds the vertical field
// of view.
Plate wall(double x0, double z0, double x1, double z1, double albedo) {
  const Vec3 from{x0, 0, z0}, to{x1, 0, z1};
  const double width = length(to - from);
  return rectangle(0.5 * (from + to), (1 / width) * (to - from), up, width, 7, albedo);
}

// Returns two side walls, a floor and a ceiling, which extend from z = 0 to length_m.
std::vector<Plate> tube(double left_x, double right_x, double length_m) {
  const Vec3 right{1, 0, 0}, away{0, 0, 1};
  const double middle_x = (left_x + right_x) / 2, middle_y = (floor_y_m + ceiling_y_m) / 2;
  const double width = right_x - left_x, height = ceiling_y_m - floor_y_m, z = length_m / 2;
  return {rectangle({left_x, middle_y, z}, away, up, length_m, height, 0.5),
          rectangle({right_x, middle_y, z}, away, up, length_m, height, 0.7),
          rectangle({middle_x, floor_y_m, z}, right, away, width, length_m, 0.3),
          rectangle({middle_x, ceiling_y_m, z}, right, away, width, length_m, 0.8)};
}

// Adds the faces of a box on the floor that are visible from the sensors: the front, both sides and
// the top.
void add_box(std::vector<Plate>& plates, double x, double front_z, double width, double height,
             double depth, double albedo) {
  const Vec3 right{1, 0, 0}, away{0, 0, 1};
  const Vec3 middle{x, floor_y_m + height / 2, front_z + depth / 2};
  plates.push_back(rectangle(middle - (depth / 2) * away, right, up, width, height, albedo));
  plates.push_back(rectangle(middle - (width / 2) * right, away, up, depth, height, albedo));
  plates.push_back(rectangle(middle + (width / 2) * right, away, up, depth, height, albedo));
  plates.push_back(rectangle(middle + (height / 2) * up, right, away, width, depth, albedo));
}

struct RoomBox {
  double x, front_z, width, height, depth, albedo;
};

Room make_room(std::string name, std::vector<Plate> walls, const std::vector<RoomBox>& boxes) {
  const std::size_t count = walls.size();
  for (const RoomBox& b : boxes)
    add_box(walls, b.x, b.front_z, b.width, b.height, b.depth, b.albedo);
  return {std::move(name), std::move(walls), count};
}

std::vector<Room> build() {
  const Plate left = wall(-3.0, 4.654, 0.1, 5.01, 0.5), right = wall(-0.3, 5.225, 3.4, 5.531, 0.7);
  const std::vector<RoomBox> boxes{{-1.6, 4.62, 0.45, 1.7, 0.10, 0.8},
                                   {-0.45, 4.64, 0.40, 1.3, 0.15, 0.4},
                                   {0.85, 4.80, 0.40, 1.6, 0.25, 0.7},
                                   {1.9, 5.02, 0.50, 1.4, 0.20, 0.9}};
  std::vector<RoomBox> moved = boxes, with_bystander = boxes;
  moved[0].x = -0.9, moved[1].x = -1.9, moved[2].x = 1.35, moved[3].x = 0.45;
  moved[3].front_z = 4.85;
  with_bystander.push_back({-2.15, 4.3, 0.45, 1.75, 0.25, 0.45});
  // The door opening is 0.9 m wide. The opening is as high as the wall, so it has no visible upper
  // edge.
  const std::vector<Plate> open{left, wall(-0.3, 5.225, 1.1, 5.341, 0.7),
                                wall(2.0, 5.415, 3.4, 5.531, 0.7), wall(0.6, 6.3, 2.6, 6.4, 0.5)};
  const std::vector<Plate> other{wall(-3.4, 5.45, -0.2, 5.2, 0.3),
                                 wall(-0.4, 5.05, 3.2, 4.75, 0.8)};
  // The end walls are the parts of the walls of "room" that lie between the side walls.
  std::vector<Plate> closed = tube(-2.2, 2.9, 5.6);
  closed.push_back(wall(-2.2, 4.746, 0.1, 5.01, 0.5));
  closed.push_back(wall(-0.3, 5.225, 2.9, 5.490, 0.7));
  return {make_room("room", {left, right}, boxes),
          make_room("moved", {left, right}, moved),
          make_room("door", open, boxes),
          make_room("bystander", {left, right}, with_bystander),
          make_room("other", other,
                    {{-1.9, 4.95, 0.60, 1.0, 0.30, 0.5},
                     {-0.7, 4.90, 0.35, 1.9, 0.20, 0.9},
                     {1.2, 4.62, 0.70, 1.2, 0.15, 0.3}}),
          make_room("closed", closed, boxes),
          make_room("corridor", tube(-1.25, 0.95, 9), {})};
}

}  // namespace

const std::vector<Room>& rooms() {
  static const std::vector<Room> all = build();
  return all;
}

const Room& room() { return rooms().front(); }

const Room* room_named(const std::string& background) {
  const auto found = std::find_if(rooms().begin(), rooms().end(),
                                  [&](const Room& r) { return r.name == background; });
  return found == rooms().end() ? nullptr : &*found;
}

std::vector<std::string> room_names() {
  std::vector<std::string> out{"none"};
  for (const Room& r : rooms()) out.push_back(r.name);
  return out;
}

Scene empty_room(const Room& of) {
  Scene scene;
  scene.room = &of;
  return scene;
}

}  // namespace echofuse::sim
