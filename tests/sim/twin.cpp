// SPDX-License-Identifier: MIT
#include "sim/twin/twin.hpp"

#include <nlohmann/json.hpp>

#include "../fixtures/error.hpp"
#include "../fixtures/record.hpp"
#include "scenes.hpp"
#include "sim/dataset/generator.hpp"
#include "sim/sensors/radar_echo.hpp"

using namespace echofuse::sim;
using namespace echofuse::test;

TEST_CASE("settings have plausible ranges, and those of the default twin contain the base value") {
  Conditions conditions;
  Settings settings;
  bind(settings, conditions);
  const auto base = nlohmann::json::parse(settings.json())["settings"];
  CHECK(base.size() == 89);
  for (const auto& [key, setting] : base.items()) {
    if (!setting.contains("min")) continue;
    CAPTURE(key);
    const double low = setting["min"], high = setting["max"], value = setting["value"];
    CHECK(low < high);
    CHECK(value >= low);
    CHECK(value <= high);
  }
  const Twin twin = twin_named("default");
  CHECK(twin.ranges.size() > 40);
  for (const KeyRange& r : twin.ranges) {
    INFO(r.key);
    const double value = base.at(r.key).at("value");
    CHECK(r.low <= value);
    CHECK(value <= r.high);
    CHECK(r.low < r.high);
  }
}

TEST_CASE("sampled parameters of simulated laboratories are independent and stay in range") {
  const Twin both = twin_named("girth = [0.8, 1.25, \"log\"]\nradar_plate = [0.1, 4]\nseed = 3");
  const Twin one = twin_named("radar_plate = [0.1, 4]\nseed = 3");
  const Twin other = twin_named("radar_plate = [0.1, 4]\nseed = 4");
  double log_girth = 0;
  for (int k = 0; k < 400; ++k) {
    const Conditions c = conditions_of(both, k, {});
    CHECK(c.girth >= 0.8);
    CHECK(c.girth <= 1.25);
    CHECK(c.radar_plate >= 0.1);
    CHECK(c.radar_plate <= 4);
    log_girth += std::log(c.girth) / 400;
    if (k >= 3) continue;
    CHECK(conditions_of(one, k, {}).radar_plate == c.radar_plate);
    CHECK(conditions_of(one, k, {}).girth == 1);
    CHECK(conditions_of(other, k, {}).radar_plate != c.radar_plate);
    CHECK(conditions_of(one, k + 1, {}).radar_plate != c.radar_plate);
  }
  CHECK(std::abs(log_girth) < 4 * std::log(1.25) / std::sqrt(3.0 * 400));
  CHECK(to_text(twin_named(to_text(both))) == to_text(both));
}

TEST_CASE("all errors of a digital-twin file are reported in one message") {
  const std::string said = refusal_by([] {
    read_twin(
        "girht = [0.5, 2]\nbaseline_m = [0, 1]\ngirth = [2, 1]\nradar_rays = [3.0, 5.0]\n"
        "limb_width = [0, 1, \"log\"]\npose_spread = [0, 9]\nseed = -1\n",
        "w.toml");
  });
  for (const char* part :
       {"w.toml:1:9: unknown key \"girht\"",
        "baseline_m: cannot have a range, because the run file contains its value",
        "girth: expected low and high", "radar_rays", "\"log\" requires a low", "from 0 to 1.5",
        "seed: expected"})
    CHECK_THAT(said, Catch::Contains(part));
}

TEST_CASE("records of alternating simulated laboratories equal those of each laboratory alone") {
  Plan plan;
  plan.people = 2;
  plan.letters = 4;
  plan.twin = to_text(twin_named("default"));
  plan.laboratories = 3;
  const Generator mixed(plan);
  plan.laboratories = 0;
  for (std::int64_t k = 0; k < 3; ++k) {
    plan.laboratory = k;
    const Generator alone(plan);
    const auto a = mixed.make(3 + k), b = alone.make(3 + k);
    CHECK(difference(a, b) == "");
  }
  plan.laboratory = 0;
  const auto there = Generator(plan).make(1);
  plan.twin.clear();
  CHECK(counts(there) != counts(Generator(plan).make(1)));
}

TEST_CASE("user settings are not sampled, and the laboratory setting requires a digital twin") {
  Plan plan;
  Settings settings;
  bind(settings, plan);
  settings.read_text("twin = \"default\"\nlaboratory = 2\nirf_fwhm_ps = 321.0\n", "x");
  resolve_twin(settings, plan);
  CHECK(plan.twin.find("irf_fwhm_ps") == std::string::npos);
  CHECK(plan.twin.find("radar_plate") != std::string::npos);
  CHECK(laboratories_of(plan).front().irf_fwhm_ps == 321);
  Plan bare;
  Settings few;
  bind(few, bare);
  few.set("laboratory=2");
  CHECK_THROWS_AS(resolve_twin(few, bare), Error);
}

TEST_CASE("radar reflectivities do not depend on the optical albedo of a surface") {
  Conditions c;
  c.radar_rays = 96;
  const Scene base = make_scene(c, SceneKind::letter, 1, 2);
  Scene body = base, plate = base;
  plate.capsules.clear();
  body.plates.clear();
  const double both = total(radar_returns(base, c).weight);
  c.radar_plate = 3;
  const Scene bright = make_scene(c, SceneKind::letter, 1, 2);
  CHECK(total(spd_returns(bright, c).weight) == total(spd_returns(base, c).weight));
  const double more = total(radar_returns(bright, c).weight) - both;
  CHECK(more == Approx(2 * total(radar_returns(plate, c).weight)).epsilon(0.02));
  c.radar_plate = 1;
  c.radar_cloth = c.radar_skin = 0;
  const Scene dark = make_scene(c, SceneKind::letter, 1, 2);
  Scene hidden = base;
  for (auto& capsule : hidden.capsules) capsule.albedo = capsule.radar = 0;
  CHECK(total(radar_returns(dark, c).weight) == Approx(total(radar_returns(hidden, c).weight)));
  c.radar_cloth = c.radar_skin = 1;
  c.radar_follows_albedo = 0;
  for (std::uint64_t i = 0; i < 5; ++i)
    CHECK(make_scene(c, SceneKind::person, 1, i).capsules[0].radar == 0.5);
}

TEST_CASE("a scattering lobe keeps the echo of a sphere and reduces the echo of a tilted plate") {
  Conditions c;
  c.baseline_m = 0;
  c.radar_rays = 2048;
  Scene ball;
  ball.capsules = {sphere({0, 0, 3}, 0.3)};
  const double lambert = total(radar_returns(ball, c).weight);
  c.radar_lobe = 3;
  CHECK(total(radar_returns(ball, c).weight) == Approx(lambert).epsilon(0.02));
  Scene plate;
  const double tilt = 0.5;
  plate.plates = {
      {{0, 0, 3}, {std::cos(tilt), 0, std::sin(tilt)}, {0, 1, 0}, {{-0.05, 0, 0.05, 0, 0.1}}, 0.8}};
  const double flat = total(radar_returns(plate, c).weight);
  c.radar_plate_lobe = 4;
  CHECK(total(radar_returns(plate, c).weight) / flat ==
        Approx(2 * std::pow(std::cos(tilt), 3)).epsilon(0.02));
}

TEST_CASE("light falls off away from the detector axis, and body sway spreads the echo in range") {
  Conditions c;
  c.spd_falloff = 1;
  c.spd_yaw_deg = 5;
  Scene left, right;
  right.capsules = {sphere({1, 0, 3}, 0.1)};
  left.capsules = {sphere({-1, 0, 3}, 0.1)};
  const double m = std::tan(5 * M_PI / 180), t = 1.0 / 3;
  CHECK(total(spd_returns(left, c).weight) / total(spd_returns(right, c).weight) ==
        Approx(std::exp(-((t + m) * (t + m) - (t - m) * (t - m)) / (0.55 * 0.55))).epsilon(0.02));
  Conditions still;
  const Scene person = make_scene(still, SceneKind::person, 1, 0);
  const Returns before = spd_returns(person, still);
  still.slot_sway_m = 0.02;
  const Returns after = spd_returns(person, still);
  REQUIRE(after.range_m.size() == before.range_m.size());
  double mean = 0, square = 0;
  for (std::size_t k = 0; k < after.range_m.size(); ++k) {
    const double moved = after.range_m[k] - before.range_m[k];
    mean += moved / static_cast<double>(after.range_m.size());
    square += moved * moved / static_cast<double>(after.range_m.size());
  }
  CHECK(std::abs(mean) < 1e-4);
  CHECK(std::sqrt(square) == Approx(0.02).epsilon(0.03));
}

TEST_CASE("bodies and letter plates have the sizes and angles that their laboratory specifies") {
  Conditions c;
  const Scene base = make_scene(c, SceneKind::letter, 1, 2);
  c.girth = 1.5;
  c.limb_width = 2;
  c.leg_length = 1.05;
  c.letter_scale = 1.2;
  c.letter_tilt_deg = 20;
  const Scene other = make_scene(c, SceneKind::letter, 1, 2);
  CHECK(other.capsules[0].radius_m == Approx(2 * base.capsules[0].radius_m));
  CHECK(other.capsules[8].radius_m == Approx(1.5 * base.capsules[8].radius_m));
  CHECK(other.capsules[11].b.y == Approx(base.capsules[11].b.y).margin(0.01));
  const Plate& p = other.plates[0];
  CHECK(length(p.u) == Approx(1));
  CHECK(length(p.v) == Approx(1));
  CHECK(dot(p.u, p.v) == Approx(0).margin(1e-12));
  CHECK(p.v.y > std::cos(0.5));
  CHECK(p.v.y < 1);
  CHECK(p.strokes[0].width_m == Approx(1.2 * base.plates[0].strokes[0].width_m));
}
