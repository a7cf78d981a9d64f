// SPDX-License-Identifier: MIT

#include "../catch.hpp"
#include "scenes.hpp"
#include "sim/scene/room.hpp"
#include "sim/sensors/gaze.hpp"
#include "sim/sensors/multipath_light.hpp"
#include "sim/sensors/multipath_patches.hpp"
#include "sim/sensors/multipath_radar.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace {

using namespace echofuse::sim;
constexpr double pi = std::numbers::pi;

// Returns a wall in the form of a plate. `u` and `v` are unit vectors in the directions of the
// width and the height.
Plate wall(Vec3 centre, Vec3 u, Vec3 v, double width_m, double height_m, double albedo) {
  return {centre, u, v, {{-width_m / 2, 0, width_m / 2, 0, height_m}}, albedo};
}
Plate side_wall(double x, double albedo) {
  return wall({x, 0, 5}, {0, 0, 1}, {0, 1, 0}, 10, 6, albedo);
}
Room room_of(std::vector<Plate> plates) {
  const std::size_t walls = plates.size();
  return {"test", std::move(plates), walls};
}
// Returns a room that measures 4 x 3 x 5 m and is centred at (0.3, 0.2, 1).
Room box() {
  const Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, middle{0.3, 0.2, 1};
  std::vector<Plate> all;
  for (const double side : {-1., 1.}) {
    all.push_back(wall(middle + (2 * side) * x, z, y, 5, 3, 0.5));
    all.push_back(wall(middle + (1.5 * side) * y, x, z, 4, 5, 0.5));
    all.push_back(wall(middle + (2.5 * side) * z, x, y, 4, 3, 0.5));
  }
  return room_of(std::move(all));
}

// Divides a wall into n x n equal patches that face the point `inside`.
std::vector<Patch> tiles(const Plate& plate, int n, Vec3 inside) {
  const Stroke& s = plate.strokes.front();
  const double width = s.u1 - s.u0, height = s.width_m;
  const Vec3 normal = cross(plate.u, plate.v);
  std::vector<Patch> out;
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k) {
      Patch p;
      p.at = plate.centre + (width * ((i + 0.5) / n - 0.5)) * plate.u +
             (height * ((k + 0.5) / n - 0.5)) * plate.v;
      p.normal = dot(normal, inside - p.at) > 0 ? normal : -1 * normal;
      p.range_m = p.cosine = 1;
      // The range and the cosine are 1, so the solid angle equals the area of the patch.
      p.solid_angle_sr = width * height / (n * n);
      out.push_back(p);
    }
  return out;
}

// Returns a scene that consists of the given room and a small plate at `at`. The plate faces the
// sensors.
Scene plate_before(const Room& room, Vec3 at, double size_m = 0.1) {
  Scene scene;
  scene.plates.push_back(wall(at, {1, 0, 0}, {0, 1, 0}, size_m, size_m, 0.6));
  scene.room = &room;
  return scene;
}

Conditions with_echoes(std::int64_t order, double reflectivity) {
  Conditions c;
  c.baseline_m = 0;
  c.radar_rays = 1024;
  c.multipath_order = order;
  c.radar_wall_reflectivity = reflectivity;
  return c;
}

// Returns the echoes that multipath adds to the direct radar echoes.
Returns echoes_by_walls(const Scene& scene, const Conditions& c) {
  Returns all = radar_returns(scene, c);
  Conditions direct = c;
  direct.multipath_order = 0;
  const auto seen = static_cast<std::ptrdiff_t>(radar_returns(scene, direct).range_m.size());
  all.range_m.erase(all.range_m.begin(), all.range_m.begin() + seen);
  all.weight.erase(all.weight.begin(), all.weight.begin() + seen);
  return all;
}

double difference(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

std::vector<double> profile(const Scene& scene, const Conditions& c) {
  return radar_power(radar_returns(scene, c), radar_response(c));
}

}  // namespace

TEST_CASE("an echo via one wall has the path length from the mirror image of the sensor") {
  const Room room = room_of({side_wall(-1.25, 0)});
  const Vec3 sensor{-0.5, 0, 0}, place{0.3, 0.2, 3};
  const auto images = image_sources(room, sensor, 2);
  // Two reflections at the only wall map the sensor to itself. This image is not listed.
  REQUIRE(images.size() == 2);
  CHECK(length(images[1].at - Vec3{-2, 0, 0}) < 1e-12);
  const auto way = way_to(images[1], sensor, place);
  REQUIRE(way);
  CHECK(way->length_m == Approx(std::sqrt(2.3 * 2.3 + 0.2 * 0.2 + 9)));
  // The departure direction is the arrival direction with the sign of x reversed.
  CHECK(length(way->departure - Vec3{-way->arrival.x, way->arrival.y, way->arrival.z}) < 1e-12);
  // The target point is behind the wall.
  CHECK_FALSE(way_to(images[1], sensor, {-2, 0, 3}));
  // The path to the target point misses the wall.
  CHECK_FALSE(way_to(images[1], sensor, {0.3, 0.2, 40}));
}

TEST_CASE("echo power via one wall equals the analytic value, and open scenes are unchanged") {
  const Room room = room_of({side_wall(-1.5, 0)});
  const Vec3 at{0.4, 0, 3};
  const Scene scene = plate_before(room, at);
  const double rho = 0.6;
  Conditions direct = with_echoes(0, rho);
  const double d = length(at), mirrored_m = length(at - Vec3{-3, 0, 0});
  // Value of z / distance^3 for the mirror image, divided by its value for the sensor.
  const double q = std::pow(d / mirrored_m, 3);
  const double whole = total(radar_returns(scene, direct).weight);
  const Returns once = echoes_by_walls(scene, with_echoes(1, rho));
  const Returns twice = echoes_by_walls(scene, with_echoes(2, rho));
  CHECK(total(once.weight) == Approx(4 * rho * q * whole).epsilon(0.01));
  CHECK(total(twice.weight) == Approx((4 * rho * q + rho * rho * q * q) * whole).epsilon(0.01));
  for (const double range : once.range_m) CHECK(range == Approx((d + mirrored_m) / 2).margin(0.06));
  // In a scene without a room, the echoes must be bit-identical to those computed without
  // multipath.
  Scene open = scene;
  open.room = nullptr;
  CHECK(radar_returns(open, with_echoes(2, rho)).weight == radar_returns(open, direct).weight);
}

TEST_CASE("reflections at the walls of a closed box conserve energy") {
  const Room room = box();
  const Vec3 sensor{-0.4, 0.1, 0.3};
  std::vector<double> met(3);
  for (const Plate& plate : room.plates)
    for (const Patch& p : tiles(plate, 60, sensor))
      for (const ImageSource& image : image_sources(room, sensor, 2))
        if (const auto way = way_to(image, sensor, p.at))
          met[static_cast<std::size_t>(image.reflections)] +=
              -dot(p.normal, way->arrival) * p.area_m2() / (4 * pi * way->length_m * way->length_m);
  for (const double share : met) CHECK(share == Approx(1).margin(0.005));
  // Each reflection absorbs the fraction 1 - rho of the power, so rho^3 remains after the third
  // reflection.
  const double rho = 0.7;
  double power = std::pow(rho, 3);
  for (std::size_t n = 0; n < 3; ++n) power += (1 - rho) * std::pow(rho, n) * met[n];
  CHECK(power == Approx(1).margin(0.005));
}

TEST_CASE("a Lambertian wall illuminates a patch with the analytic form factor") {
  // Form factor B-3 in Howell's catalogue describes a patch that is parallel to a rectangle and
  // faces one of its corners.
  Patch patch;
  patch.at = {0, 0, 0}, patch.normal = {0, 0, 1};
  patch.range_m = patch.cosine = 1, patch.solid_angle_sr = 1e-4;
  for (const double h : {0.5, 1., 3.}) {
    const double a = 1.5, b = 2, x = a / h, y = b / h;
    const double sx = std::sqrt(1 + x * x), sy = std::sqrt(1 + y * y);
    const double expected = (x / sx * std::atan(y / sx) + y / sy * std::atan(x / sy)) / (2 * pi);
    double sum = 0;
    for (const Patch& p :
         tiles(wall({a / 2, b / 2, h}, {1, 0, 0}, {0, 1, 0}, a, b, 1), 12, patch.at))
      sum += form_factor(patch, p);
    CHECK(sum == Approx(expected).epsilon(0.02));
  }
  patch.normal = {0, 0, -1};
  CHECK(form_factor(patch, tiles(screen(2, 1), 1, {}).front()) == 0);
}

TEST_CASE("light reflected via a wall equals the integral over the wall for both path directions") {
  const double albedo = 0.7;
  const Room room = room_of({side_wall(-1.2, albedo)});
  const Vec3 at{0.1, 0.1, 4};
  const Scene scene = plate_before(room, at);
  Conditions c;
  const Gaze gaze = spd_gaze(c);
  Returns by_wall, fine;
  add_light_by_walls(scene, gaze, 1, RoomReturns::subtracted, by_wall, {24, 512});
  add_light_by_walls(scene, gaze, 1, RoomReturns::subtracted, fine, {160, 512});
  const Vec3 facing{0, 0, -1};
  double integral = 0;
  for (const Patch& p : tiles(room.plates[0], 400, at)) {
    const double r = length(p.at);
    if (p.at.z <= 0 || std::abs(p.at.x / p.at.z) > c.half_tangent ||
        std::abs(p.at.y / p.at.z) > c.half_tangent)
      continue;
    const Vec3 way = p.at - at;
    const double d = length(way);
    integral += std::max(0.0, dot(facing, way)) * std::max(0.0, -dot(p.normal, way)) /
                (pi * d * d * d * d) * -dot(p.normal, p.at) / (r * r * r) * p.area_m2();
  }
  const double r2 = dot(at, at), solid_angle = 0.01 * at.z / (r2 * std::sqrt(r2));
  const double expected = 2 * 0.6 * solid_angle * albedo * integral / mean_scene_weight;
  CHECK(total(fine.weight) == Approx(expected).epsilon(0.02));
  CHECK(total(by_wall.weight) == Approx(expected).epsilon(0.05));
  // By Fermat's principle, no path via the wall is shorter than the straight path from the mirror
  // image.
  const double shortest = (length(at - Vec3{-2.4, 0, 0}) + length(at)) / 2;
  CHECK(*std::min_element(fine.range_m.begin(), fine.range_m.end()) > shortest - 0.06);
}

TEST_CASE("light after two reflections equals the sum over all pairs of wall patches") {
  const Vec3 at{0.1, 0.1, 4};
  const Gaze gaze = spd_gaze({});
  const auto light = [&](const Room& room, std::int64_t order) {
    Returns out;
    add_light_by_walls(plate_before(room, at), gaze, order, RoomReturns::subtracted, out,
                       {40, 512});
    return out;
  };
  const double r2 = dot(at, at), area = 0.01, cosine = at.z / std::sqrt(r2);
  const double direct = 0.6 * area * cosine * cosine / (r2 * r2) / mean_scene_weight;
  // A flat wall does not illuminate itself, so the only second-order path leads from the wall to
  // the object and back to the wall. Let A be the object's area times its albedo, and E the light
  // that reaches the object via the wall. The weights are A cos^2 / R^4 (direct), 2 A E cos / R^2
  // (first order) and A E^2 (second order).
  const Room one = room_of({side_wall(-1.2, 0.7)});
  const double first = total(light(one, 1).weight);
  CHECK(total(light(one, 2).weight) - first == Approx(first * first / (4 * direct)).epsilon(0.02));

  const Room two = room_of({side_wall(-1.2, 0.7), side_wall(0.9, 0.5)});
  Patch body;
  body.at = at, body.normal = {0, 0, -1}, body.range_m = body.cosine = 1,
  body.solid_angle_sr = area;
  std::vector<Patch> lit;
  for (const Plate& plate : two.plates)
    for (Patch p : tiles(plate, 60, at))
      if (p.at.z > 0 && std::abs(p.at.x / p.at.z) < gaze.half_tangent &&
          std::abs(p.at.y / p.at.z) < gaze.half_tangent)
        p.albedo = plate.albedo, lit.push_back(p);
  const auto exitance = [](const Patch& p) {
    return p.albedo * -dot(p.normal, p.at) / std::pow(length(p.at), 3);
  };
  double by_one = 0, by_two = 0;
  for (const Patch& q : lit) {
    const double share = form_factor(body, q);
    by_one += share * exitance(q);
    for (const Patch& p : lit)
      if (share > 0) by_two += share * q.albedo * form_factor(q, p) * exitance(p);
  }
  const double expected =
      0.6 * area * (2 * cosine / r2 * by_two + by_one * by_one) / mean_scene_weight;
  const double second = total(light(two, 2).weight) - total(light(two, 1).weight);
  CHECK(second == Approx(expected).epsilon(0.03));
}

TEST_CASE("unequal side walls break the left-right symmetry of light and radar echoes") {
  Conditions c = with_echoes(2, 0.9);
  c.radar_rays = 288, c.radar_resolution_m = 0.1, c.radar_step_m = 0.05, c.radar_bins = 140;
  Conditions direct = c;
  direct.multipath_order = 0;
  const Room similar = room_of({side_wall(-1.2, 0), side_wall(1.2, 0)});
  const Room differ = room_of({side_wall(-1.2, 0), side_wall(0.9, 0)});
  Scene scene = make_scene(c, {SceneKind::person}, 3, 0);
  // The albedo of the walls is 0, so the walls themselves cause no direct echo.
  const auto sides = [&](const Room& room, const Conditions& how) {
    scene.room = &room;
    const auto seen = profile(scene, how);
    return difference(seen, profile(mirrored(scene), how)) /
           *std::max_element(seen.begin(), seen.end());
  };
  CHECK(sides(differ, direct) < 1e-3);
  CHECK(sides(similar, c) < 1e-3);
  CHECK(sides(differ, c) > 0.03);

  const Room bright = room_of({side_wall(-1.2, 0.8), side_wall(1.2, 0.2)});
  scene.room = &bright;
  const auto by_walls = [&](const Scene& s) {
    Returns out;
    add_light_by_walls(s, spd_gaze(c), 1, RoomReturns::subtracted, out);
    return spd_rate(out, c);
  };
  const auto seen = by_walls(scene);
  // Both ends of a capsule are alike.
  Scene turned = scene;
  for (Capsule& capsule : turned.capsules) std::swap(capsule.a, capsule.b);
  CHECK(difference(seen, by_walls(turned)) < 1e-6 * *std::max_element(seen.begin(), seen.end()));
  CHECK(difference(seen, by_walls(mirrored(scene))) >
        0.1 * *std::max_element(seen.begin(), seen.end()));
}

TEST_CASE(
    "scene light equals empty-room light plus the change due to a person, and radar_wall_scatter "
    "scales the wall echoes") {
  Conditions c;
  c.background = "closed", c.multipath_order = 2, c.spd_rays = 64;
  const Scene scene = make_scene(c, {SceneKind::person}, 3, 0);
  const auto rate = [&](const Scene& of, RoomReturns room) {
    Returns out;
    spd_returns(of, c, out, room);
    return spd_rate(out, c);
  };
  const auto whole = rate(scene, RoomReturns::included),
             empty = rate(empty_room(*scene.room), RoomReturns::included);
  const auto change = rate(scene, RoomReturns::subtracted);
  for (std::size_t i = 0; i < whole.size(); ++i)
    CHECK(whole[i] == Approx(empty[i] + change[i]).epsilon(1e-6).margin(1e-3));

  // The setting radar_wall_scatter reduces the direct echoes of the walls, whether or not a person
  // is present.
  c.multipath_order = 0;
  Conditions smooth = c;
  smooth.radar_wall_scatter = 0.25;
  const Scene nobody = empty_room(*scene.room);
  CHECK(total(radar_returns(nobody, smooth).weight) ==
        Approx(0.25 * total(radar_returns(nobody, c).weight)));
  Returns all, quarter;
  radar_returns(scene, c, all, RoomReturns::subtracted);
  radar_returns(scene, smooth, quarter, RoomReturns::subtracted);
  for (std::size_t k = 0; k < all.weight.size(); ++k)
    if (all.weight[k] < 0 && quarter.weight[k] != Approx(0.25 * all.weight[k])) FAIL(k);
}
