// SPDX-License-Identifier: MIT

#include "../fixtures/folder.hpp"
#include "../fixtures/record.hpp"
#include "acquire/record/run_reader.hpp"
#include "scenes.hpp"
#include "sim/dataset/generator.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/zone_fields.hpp"

using namespace echofuse::sim;
using namespace echofuse::test;

namespace {

Conditions with_zones(std::int64_t side) {
  Conditions c;
  c.spd_zones = side, c.background_counts = 900;
  return c;
}

// Returns the expected number of counts in each zone, summed over all bins.
std::vector<double> light(const Scene& scene, const Conditions& c) {
  const std::vector<double> rates = zone_rates(spd_returns(scene, c), c);
  const auto bins = static_cast<std::size_t>(c.bins);
  std::vector<double> out(rates.size() / bins);
  for (std::size_t i = 0; i < rates.size(); ++i) out[i / bins] += rates[i];
  return out;
}

}  // namespace

TEST_CASE("counts of all detector zones add up to those of a single pixel in each bin") {
  const Conditions one = with_zones(1);
  for (const std::int64_t side : {3, 4, 8}) {
    const Conditions c = with_zones(side);
    for (std::uint64_t k = 0; k < 4; ++k) {
      const Scene scene = some_scene(c, k);
      const std::vector<double> single = spd_rate(spd_returns(scene, one), one);
      const std::vector<double> sum =
          sum_of_zones(zone_rates(spd_returns(scene, c), c), single.size());
      for (std::size_t i = 0; i < single.size(); ++i) CHECK(sum[i] == Approx(single[i]));
    }
  }
}

TEST_CASE("a small body gives the most counts in the detector zone that points at it") {
  const Conditions c = with_zones(3);
  const Zones zones = zones_of(c);
  REQUIRE(zones.size() == 9);
  for (std::size_t z = 0; z < 9; ++z) {
    Scene scene;
    scene.capsules = {sphere({3 * zones[z].x, 3 * zones[z].y, 3}, 0.1)};
    const std::vector<double> counts = light(scene, c);
    CHECK(std::max_element(counts.begin(), counts.end()) - counts.begin() ==
          static_cast<std::ptrdiff_t>(z));
  }
}

TEST_CASE("zone directions and widths stored in a run match the simulated fields of view") {
  const Zones zones = zones_of(with_zones(4));
  REQUIRE(zones.size() == 16);
  CHECK(zones[0].x == Approx(-0.4125));
  CHECK(zones[0].y == Approx(0.4125));
  CHECK(zones[1].x - zones[0].x == Approx(0.275));
  CHECK(zones[0].width == Approx(2.3548 * 0.75 * 0.275).epsilon(1e-3));
  CHECK(zones_of(with_zones(1)) == single_pixel());
}

TEST_CASE(
    "detector zone sensitivity falls to exp(-1/2) at 0.75 times the zone pitch from the centre") {
  const Conditions c = with_zones(8);
  const Zones zones = zones_of(c);
  const auto at = [&](double x) {
    Scene scene;
    scene.capsules = {sphere({5 * x, 5 * zones[27].y, 5}, 0.1)};
    return light(scene, c)[27] - c.background_counts / 64;
  };
  const double pitch = zones[1].x - zones[0].x;
  CHECK(at(zones[27].x + 0.75 * pitch) / at(zones[27].x) == Approx(std::exp(-0.5)).epsilon(0.05));
}

TEST_CASE("detector zones do not change the depth maps or the total counts") {
  const test::Folder folder;
  Plan plan;
  plan.people = 3, plan.letters = 3;
  plan.conditions.background = "room";
  write_dataset(plan, {folder / "one", "", 2, true});
  plan.conditions.spd_zones = 3;
  write_dataset(plan, {folder / "nine", "", 2, true});
  const record::RunReader one(folder / "one"), nine(folder / "nine");
  CHECK(nine.axis("spd")->zones == zones_of(plan.conditions));
  CHECK(one.axis("spd")->zones == single_pixel());
  for (std::int64_t i = 0; i < 6; ++i) {
    const auto single = one.read(i), zones = nine.read(i);
    REQUIRE(counts(zones).size() == 9 * counts(single).size());
    CHECK(depth_mm(zones) == depth_mm(single));
    const auto clicks = static_cast<double>(single.spd_counts.in_range);
    CHECK(std::abs(static_cast<double>(zones.spd_counts.in_range) - clicks) <
          5 * std::sqrt(2 * clicks));
  }
}
