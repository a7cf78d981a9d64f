// SPDX-License-Identifier: MIT
#include "sim/scene/room.hpp"

namespace echofuse::sim {
namespace {

constexpr double floor_y_m = -1.1;
constexpr Vec3 up{0, 1, 0};

Plate rectangle(Vec3 centre, Vec3 u, Vec3 v, double width_m, double height_m, double albedo) {
  return {centre, u, v, {{-width_m / 2, 0, width_m / 2, 0, height_m}}, albedo};
}

// Upright, from (x0, z0) to (x1, z1), wide enough to fill the field of view vertically.
Plate wall(double x0, double z0, double x1, double z1, double albedo) {
  const Vec3 from{x0, 0, z0}, to{x1, 0, z1};
  const double width = length(to - from);
  return rectangle(0.5 * (from + to), (1 / width) * (to - from), up, width, 7, albedo);
}

// On the floor; the faces that can be seen from the front: front, both sides, top.
void add_box(std::vector<Plate>& plates, double x, double front_z, double width, double height,
             double depth, double albedo) {
  const Vec3 right{1, 0, 0}, away{0, 0, 1};
  const Vec3 middle{x, floor_y_m + height / 2, front_z + depth / 2};
  plates.push_back(rectangle(middle - (depth / 2) * away, right, up, width, height, albedo));
  plates.push_back(rectangle(middle - (width / 2) * right, away, up, depth, height, albedo));
  plates.push_back(rectangle(middle + (width / 2) * right, away, up, depth, height, albedo));
  plates.push_back(rectangle(middle + (height / 2) * up, right, away, width, depth, albedo));
}

std::vector<Plate> build() {
  std::vector<Plate> plates{wall(-3.0, 4.654, 0.1, 5.01, 0.5), wall(-0.3, 5.225, 3.4, 5.531, 0.7)};
  add_box(plates, -1.6, 4.62, 0.45, 1.7, 0.10, 0.8);
  add_box(plates, -0.45, 4.64, 0.40, 1.3, 0.15, 0.4);
  add_box(plates, 0.85, 4.80, 0.40, 1.6, 0.25, 0.7);
  add_box(plates, 1.9, 5.02, 0.50, 1.4, 0.20, 0.9);
  return plates;
}

}  // namespace

const std::vector<Plate>& room() {
  static const std::vector<Plate> plates = build();
  return plates;
}

Scene empty_room() {
  Scene scene;
  scene.room = true;
  return scene;
}

}  // namespace echofuse::sim
