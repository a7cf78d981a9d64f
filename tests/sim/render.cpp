// SPDX-License-Identifier: MIT

#include "../catch.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "scenes.hpp"

using namespace echofuse::sim;

namespace {

Axis x_axis(std::uint32_t n) { return record::depth_x_axis(n, 0.55); }
Axis y_axis(std::uint32_t n) { return record::depth_y_axis(n, 0.55); }

}  // namespace

TEST_CASE("rays from both sensors hit a sphere at the computed points") {
  const Vec3 centre{0.6, 0.2, 3.5};
  Scene scene;
  scene.capsules = {sphere(centre, 0.3)};
  for (const double sensor_x : {0.0, -0.5}) {
    const Vec3 to_centre = centre - Vec3{sensor_x, 0, 0};
    // The scene is rendered with a single ray, which points exactly at the centre of the sphere.
    const Axis x{"x", "tangent", "1", 1, to_centre.x / to_centre.z, 1e-3};
    const Axis y{"y", "tangent", "1", 1, to_centre.y / to_centre.z, 1e-3};
    const Hit hit = cast(scene, sensor_x, x, y)[0];
    CHECK(hit.range_m == Approx(length(to_centre) - 0.3).epsilon(1e-6));
    CHECK(hit.z_m == Approx(to_centre.z * (1 - 0.3 / length(to_centre))).epsilon(1e-6));
    CHECK(hit.cos_theta == Approx(1).epsilon(1e-6));
  }
}

TEST_CASE("each ray hit is on the capsule surface and has the cosine of the angle of incidence") {
  // The capsules are tilted in either direction, level or upright. Some are partly outside the
  // image or next to the sensor.
  const Capsule capsule = GENERATE(Capsule{{-0.3, -0.5, 3.2}, {0.4, 0.6, 3.9}, 0.15, 0.5},
                                   Capsule{{0.7, -0.5, 2.2}, {-0.4, 0.9, 2.9}, 0.07, 0.5},
                                   Capsule{{-0.9, 0.2, 2}, {0.8, 0.2, 3}, 0.1, 0.5},
                                   Capsule{{0.3, 0.8, 2.5}, {0.3, -0.8, 2.5}, 0.08, 0.5},
                                   Capsule{{-3, -2, 2.5}, {0.1, 0.2, 2.6}, 0.07, 0.5},
                                   Capsule{{0.5, 0.1, 0.1}, {0.2, 0.1, 3}, 0.1, 0.5});
  constexpr std::uint32_t side = 200;
  Scene scene;
  scene.capsules = {capsule};
  const Axis x = x_axis(side), y = y_axis(side);
  const auto hits = cast(scene, 0, x, y);
  int seen = 0;
  for (std::uint32_t iy = 0; iy < side; ++iy)
    for (std::uint32_t ix = 0; ix < side; ++ix) {
      const Hit& hit = hits[iy * side + ix];
      const Vec3 ray{x.at(ix), y.at(iy), 1}, axis = capsule.b - capsule.a;
      // Searches the axis of the capsule in small steps for its smallest distance from the ray,
      // which is used as a reference.
      double least = INFINITY;
      for (int k = 0; k <= 400; ++k) {
        const Vec3 p = capsule.a + (k / 400.0) * axis;
        least = std::min(least, length(cross(p, ray)) / length(ray));
      }
      if (least > capsule.radius_m + 1e-4) CHECK(hit.z_m == 0);
      if (least < capsule.radius_m - 1e-4) CHECK(hit.z_m > 0);
      if (hit.z_m == 0) continue;
      ++seen;
      const Vec3 point = static_cast<double>(hit.z_m) * ray;
      const double s = std::clamp(dot(point - capsule.a, axis) / dot(axis, axis), 0.0, 1.0);
      const Vec3 out = point - capsule.a - s * axis;
      CHECK(length(out) == Approx(capsule.radius_m).margin(2e-6));
      CHECK(hit.cos_theta == Approx(-dot(out, ray) / length(out) / length(ray)).margin(2e-5));
      CHECK(hit.range_m == Approx(length(point)).epsilon(1e-6));
    }
  CHECK(seen > 1000);
}

TEST_CASE("the strokes of a letter are rendered at their positions with gaps between them") {
  // The plate is an L of 0.4 x 0.4 m at z = 2 m. The test casts rays through selected points.
  Scene scene;
  scene.plates = {{{0.1, 0, 2},
                   {1, 0, 0},
                   {0, 1, 0},
                   {{-0.15, -0.2, -0.15, 0.2, 0.1}, {-0.2, -0.15, 0.2, -0.15, 0.1}},
                   0.8}};
  const auto z_at = [&](double u, double v) {
    const Axis x{"x", "tangent", "1", 1, (0.1 + u) / 2, 1e-3};
    const Axis y{"y", "tangent", "1", 1, v / 2, 1e-3};
    return static_cast<double>(cast(scene, 0, x, y)[0].z_m);
  };
  for (const auto& [u, v] : {std::pair{-0.199, 0.199}, {-0.101, 0.0}, {0.199, -0.199}})
    CHECK(z_at(u, v) == 2);
  for (const auto& [u, v] : {std::pair{-0.099, 0.0}, {0.0, 0.0}, {-0.201, 0.0}, {-0.15, 0.201}})
    CHECK(z_at(u, v) == 0);
}

TEST_CASE("occlusion is computed separately for each sensor position") {
  // Seen from the origin, the small sphere is behind the large sphere.
  Scene scene;
  scene.capsules = {sphere({0, 0, 3}, 0.1, 0.5), sphere({0, 0, 4}, 0.05, 0.7)};
  const Conditions c;
  const auto farthest = [](const Returns& r) {
    return *std::max_element(r.range_m.begin(), r.range_m.end());
  };
  CHECK(farthest(spd_returns(scene, c)) < 3.1);
  CHECK(farthest(radar_returns(scene, c)) > 3.8);
  Conditions together = c;
  together.baseline_m = 0;
  CHECK(farthest(radar_returns(scene, together)) < 3.1);
}

TEST_CASE("depth images contain z in millimetres, limited to 16 bits") {
  Scene scene;
  for (const auto& [z_m, expected] : {std::pair{65.5346, 65535}, {65.54, 0}, {2.0006, 2001}}) {
    scene.plates = {screen(z_m, 0.5)};
    for (const auto mm : render_depth_mm(scene, x_axis(64), y_axis(64))) REQUIRE(mm == expected);
  }
}

TEST_CASE("a flat screen and a sphere return the analytic amount of light") {
  Conditions c;
  c.spd_rays = 1024;
  // Checks the light from the part of the scene within range r. Only pixels on the edge of the
  // circle within this range may be wrong. There are at most 8 tangent / step such pixels, where
  // `tangent` is that of the circle. Each has the weight `weight`.
  const auto check = [&](const Scene& scene, double r, double expected, double tangent,
                         double weight) {
    const Returns returns = spd_returns(scene, c);
    double sum = 0;
    for (std::size_t k = 0; k < returns.weight.size(); ++k)
      if (returns.range_m[k] < r) sum += returns.weight[k];
    const double edge = 8 * tangent * 2 * c.half_tangent / static_cast<double>(c.spd_rays) *
                        weight / mean_scene_weight;
    CAPTURE(r, sum, expected, edge);
    CHECK(std::abs(sum - expected / mean_scene_weight) < edge);
    CHECK(edge < 0.1 * sum);
  };
  constexpr double albedo = 0.6, d = 3, a = 0.8, k = d * d - a * a, pi = std::numbers::pi;
  Scene flat, round;
  flat.plates = {screen(d, albedo)};
  // The weight of the part of the screen within range r is the integral of albedo cos dOmega / R^2.
  for (const double tangent : {0.1, 0.2, 0.35, 0.5}) {
    const double r = d * std::hypot(1, tangent);
    check(flat, r, albedo * pi / (2 * d * d) * (1 - std::pow(d / r, 4)), tangent, albedo / (d * d));
  }
  // A ray at angle alpha from the axis hits the sphere at range R with angle of incidence theta.
  // The sphere has radius a, and its centre is at distance d. Therefore, d^2 = R^2 + a^2 + 2 R a
  // cos(theta) and 2 d R cos(alpha) = d^2 + R^2 - a^2. The weight within range r is the integral of
  // 2 pi albedo cos(theta) / R^2 over cos(alpha).
  round.capsules = {sphere({0, 0, d}, a, albedo)};
  const auto integral = [&](double r) {
    return std::log(r) + k / (r * r) - k * k / (4 * r * r * r * r);
  };
  for (const double r : {2.25, 2.3, 2.4, 2.6})
    check(round, r, albedo * pi / (2 * d * a) * (integral(r) - integral(d - a)),
          std::tan(std::acos((d * d + r * r - a * a) / (2 * d * r))),
          albedo * (d * d - r * r - a * a) / (2 * r * a) / (r * r));
}

TEST_CASE("the mean amount of light returned by simulated scenes equals the documented reference") {
  const Conditions c;
  constexpr int scenes = 1000;
  double sum = 0, squares = 0;
  for (std::uint64_t i = 0; i < scenes; ++i) {
    const auto kind = i % 4 == 0 ? SceneKind::person : SceneKind::letter;
    const double w = total(spd_returns(make_scene(c, kind, 3, i), c).weight);
    sum += w;
    squares += w * w;
  }
  const double mean = sum / scenes;
  const double se = std::sqrt((squares / scenes - mean * mean) / scenes);
  CHECK(std::abs(mean - 1) < 3 * se);
}
