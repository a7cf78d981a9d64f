// SPDX-License-Identifier: MIT

#include <set>

#include "../fixtures/error.hpp"
#include "drivers/util/settings.hpp"
#include "scenes.hpp"
#include "sim/scene/room.hpp"

using namespace echofuse::sim;

TEST_CASE("simulated people have realistic heights and stand on the floor inside the area") {
  const Conditions c;
  for (std::uint64_t i = 0; i < 300; ++i) {
    const Scene scene = make_scene(c, SceneKind::person, 1, i);
    for (const auto& [seed, index] : {std::pair<std::uint64_t, std::uint64_t>{2, i}, {1, i + 1}})
      CHECK(scene.capsules[0].radius_m !=
            make_scene(c, SceneKind::person, seed, index).capsules[0].radius_m);
    REQUIRE(scene.capsules.size() == 16);
    double lowest = INFINITY, trunk_top = -INFINITY;
    for (const auto& capsule : scene.capsules)
      for (const Vec3 end : {capsule.a, capsule.b}) {
        lowest = std::min(lowest, end.y - capsule.radius_m);
        CHECK(std::abs(end.x) < c.target_x_m + 0.8);
        CHECK(end.z > c.target_z_min_m - 0.8);
        CHECK(end.z < c.target_z_max_m + 0.8);
      }
    // Capsules 6 to 11 form the trunk from pelvis to head.
    for (std::size_t k = 6; k < 12; ++k)
      trunk_top = std::max(trunk_top, scene.capsules[k].b.y + scene.capsules[k].radius_m);
    CHECK(lowest == Approx(-c.camera_height_m).margin(1e-9));
    const double height = trunk_top - lowest;
    // The height of people who bend forward with bent knees may be less than 1.55 m.
    CHECK(height > 1.45);
    CHECK(height < 1.91);
    CHECK(scene.capsules[0].albedo >= 0.3);
    CHECK(scene.capsules[0].albedo <= 0.7);
  }
}

TEST_CASE("simulated people hold a letter in both hands, facing the sensors within 30 degrees") {
  const Conditions c;
  std::set<std::string> seen;
  double lift_m = 0;
  for (std::uint64_t i = 0; i < 300; ++i) {
    const Scene scene = make_scene(c, SceneKind::letter, 1, i);
    REQUIRE(scene.plates.size() == 1);
    REQUIRE(scene.label.size() == 8);
    CHECK(scene.label.substr(0, 7) == "letter:");
    seen.insert(scene.label.substr(7));
    const Plate& plate = scene.plates[0];
    const Capsule& trunk = scene.capsules[6];
    const Vec3 body = 0.5 * (trunk.a + trunk.b), to_sensors{-body.x, 0, -body.z};
    // To a viewer in front of the plate, u must point to the right and v upwards.
    const Vec3 facing = cross(plate.v, plate.u);
    CHECK(dot(facing, to_sensors) / length(to_sensors) > std::cos(30.5 * 3.14159265 / 180));
    CHECK(length(plate.centre - body) > 0.5);
    lift_m += (plate.centre - 0.5 * (scene.capsules[12].a + scene.capsules[14].a)).y / 300;
    for (const std::size_t hand : {13u, 15u})
      CHECK(length(scene.capsules[hand].b - plate.centre) < 0.2);
  }
  std::string all;
  for (const auto& letter : seen) all += letter;
  CHECK(all == "ACEHLNOTUX");
  // The letter is held 0.02 body heights above to 0.12 below the shoulders.
  CHECK(lift_m == Approx(-0.05 * 1.72).margin(0.02));
}

TEST_CASE("empty scenes contain no body, and scenes of two people contain two bodies") {
  const Conditions c;
  CHECK(make_scene(c, SceneKind::empty, 1, 0).capsules.empty());
  CHECK(make_scene(c, SceneKind::empty, 1, 0).label == "empty");
  for (std::uint64_t i = 0; i < 50; ++i) {
    const Scene two = make_scene(c, SceneKind::two_people, 1, i);
    REQUIRE(two.capsules.size() == 32);
    CHECK(two.label == "two_people");
    // The first person is to the left of the second person, or at most 0.3 m to the right of that
    // person.
    CHECK(two.capsules[6].a.x < two.capsules[22].a.x + 0.3);
  }
}

TEST_CASE("the simulated room fills the view behind the people within the range of the histogram") {
  Conditions c;
  c.background = "room";
  const Scene empty = make_scene(c, SceneKind::empty, 1, 0);
  const Returns returns = spd_returns(empty, c);
  CHECK(returns.range_m.size() == static_cast<std::size_t>(rays_of(c) * rays_of(c)));
  const auto [nearest, farthest] =
      std::minmax_element(returns.range_m.begin(), returns.range_m.end());
  CHECK(*nearest > 4.6);
  CHECK(*farthest < 7.0);
  for (const auto& plate : room().plates) CHECK(plate.centre.z > 4.6);
}

TEST_CASE("simulated rooms have walls and furniture of the stated sizes and albedos") {
  struct Row {
    const char* name;
    double depth_m, albedo;  // means over all rays that hit a surface
  };
  for (const Row& row : {Row{"room", 5.05862, 0.607608}, Row{"moved", 5.05875, 0.606158},
                         Row{"door", 5.17037, 0.584892}, Row{"other", 5.06025, 0.588211},
                         Row{"bystander", 5.04073, 0.605408}, Row{"corridor", 3.33087, 0.574565},
                         Row{"closed", 4.27005, 0.565503}}) {
    Conditions c;
    c.background = row.name;
    const Axis x{"x", "tangent", "1", 128, -0.635, 0.01}, y{"y", "tangent", "1", 96, -0.475, 0.01};
    double hits = 0, depth_m = 0, albedo = 0;
    for (const Hit& hit : cast(make_scene(c, SceneKind::empty, 1, 0), 0, x, y))
      if (hit.z_m > 0) ++hits, depth_m += hit.z_m, albedo += hit.albedo;
    CAPTURE(row.name, depth_m / hits, albedo / hits);
    CHECK(depth_m / hits == Approx(row.depth_m).epsilon(1e-5));
    CHECK(albedo / hits == Approx(row.albedo).epsilon(1e-5));
  }
}

TEST_CASE("contradictory conditions of a simulation are refused, and limits are accepted") {
  const std::string taps = "radar_taps: expected 3 to 64 numbers", zones = "expected 1, 3, 4 or 8";
  const auto [settings, why] = GENERATE_COPY(table<std::vector<std::string>, std::string>(
      {{{"spd_rays=15"}, "spd_rays is 15; expected 0, or a whole number from 16"},
       {{"spd_rays=1"}, "spd_rays is 1"},
       {{"spd_rays=16", "spd_zones=3", "spd_dead_time_ps=1", "pulses_per_window=1"}, ""},
       {{"spd_zones=2"}, zones},
       {{"spd_zones=5"}, zones},
       {{"spd_zones=7"}, zones},
       {{"spd_zones=3", "multipath_order=1"}, "the simulated light from walls has no direction"},
       {{"spd_dead_time_ps=1", "pulses_per_window=0"}, "spd_dead_time_ps needs pulses_per_window"},
       {{"map_half_tangent=0.019"}, "map_half_tangent: expected 0, or 0.02 to 3"},
       {{"map_half_tangent=0.02", "radar_antennas=8", "spd_zones=4"}, ""},
       {{"radar_antennas=9"}, "radar_antennas is 9; expected 0 to 8, or 12"},
       {{"radar_antennas=11"}, "radar_antennas is 11"},
       {{"radar_antennas=12", "radar_frames=13", "spd_zones=8"}, ""},
       {{"radar_antennas=12", "radar_frames=12"}, "radar_frames is 12; expected more than"},
       {{"radar_antennas=1", "radar_frames=1"}, "radar_frames is 1; expected more than"},
       {{"target_z_min_m=3", "target_z_max_m=2.9"}, "target_z_min_m is greater"},
       {{"height_min_m=1.8", "height_max_m=1.7"}, "height_min_m is greater"},
       {{"albedo_min=0.5", "albedo_max=0.4"}, "albedo_min is greater"},
       {{"spd_zones=1", "multipath_order=1", "target_z_min_m=3", "target_z_max_m=3",
         "height_min_m=1.8", "height_max_m=1.8", "albedo_min=0.5", "albedo_max=0.5"},
        ""},
       {{"radar_taps=1 0.5"}, taps},
       {{"radar_taps=0 0.5 0.9 0.5 0"}, taps},
       {{"radar_taps=0 0.5 1 1.2 0"}, taps},
       {{"radar_taps=0 0.5 1 x 0"}, taps}}));
  Conditions c;
  Settings s;
  bind(s, c);
  for (const std::string& assignment : settings) s.set(assignment);
  CAPTURE(settings);
  const std::string said = test::refusal_by([&] { validate(c); });
  CHECK(said.empty() == why.empty());
  CHECK_THAT(said, Catch::Contains(why));
}
