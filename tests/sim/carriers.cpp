// SPDX-License-Identifier: MIT
// Speckle at several carriers, and how the radar's power varies within a record.
#include <catch2/catch.hpp>
#include <cmath>

#include "antenna_scenes.hpp"
#include "drivers/core/axis.hpp"
#include "sim/dataset/dataset.hpp"
#include "sim/sensors/antennas.hpp"

using namespace echofuse;
using namespace echofuse::sim;

namespace {

// Who stands as a stone, in a range cell so wide that all of the body is in the middle of it.
Conditions stone(std::int64_t carriers) {
  Conditions c = of_sum("coherent");
  c.radar_sway_m = c.radar_twist_deg = c.radar_breath_m = 0;
  c.radar_frames = 13;
  c.radar_resolution_m = 50, c.radar_step_m = 3.5, c.radar_bins = 2;
  c.radar_carriers = carriers;
  return c;
}

// Patches all over a depth of 0.5 m about 3.5 m.
constexpr double depth_m = 0.5;
Returns slab() {
  Returns out;
  constexpr int patches = 400;
  for (int k = 0; k < patches; ++k) {
    out.range_m.push_back(3.5 + depth_m * ((k + 0.5) / patches - 0.5));
    out.weight.push_back(1.0 / patches);
    out.place.push_back({0, 0, static_cast<float>(k % 16) * 0.1f, 0});
  }
  return out;
}

AntennaRadar radar_of(const Conditions& c, double step_mhz) {
  AntennaRadar radar{radar_response(c), antennas_in_layout(1), 7};
  radar.carriers_hz.clear();
  for (std::int64_t k = 0; k < c.radar_carriers; ++k)
    radar.carriers_hz.push_back(1e6 * step_mhz * static_cast<double>(k));
  return radar;
}

double sinc(double x) { return x == 0 ? 1 : std::sin(pi * x) / (pi * x); }

}  // namespace

TEST_CASE("the carriers spread over what the sweep leaves of 4 GHz") {
  Conditions c;
  CHECK(carriers_hz(c) == std::vector<double>{0});
  c.radar_carriers = 4;
  const auto all = carriers_hz(c);
  REQUIRE(all.size() == 4);
  CHECK(all[3] == Approx(4e9 - speed_of_light_m_s / (2 * 0.5)));
  CHECK(all[1] == Approx(all[3] / 3));
  CHECK_NOTHROW(validate(c));
  c.radar_resolution_m = 0.037;
  CHECK_THROWS_WITH(validate(c), Catch::Contains("do not fit into 4 GHz"));
}

// Powers of fully developed speckle at two carriers correlate with |mean exp(4 pi i R df / c)|^2,
// sinc^2(2 L df / c) of a depth L (Goodman 2007, 5.3); the variance of the mean of N of them, over
// its square, is the mean over all pairs.
TEST_CASE("looks of N carriers are those of the sinc of their step") {
  const Returns body = slab();
  constexpr int records = 500;
  for (const double step_mhz : {75.0, 150.0, 300.0, 900.0}) {
    const Conditions c = stone(4);
    const AntennaRadar radar = radar_of(c, step_mhz);
    double expected = 0;
    for (const double a : radar.carriers_hz)
      for (const double b : radar.carriers_hz)
        expected += std::pow(sinc(2 * depth_m * (a - b) / speed_of_light_m_s), 2) / 16;
    Rng rng(11);
    double sum = 0, squares = 0, over_carriers = 0, over_frames = 0;
    for (int i = 0; i < records; ++i) {
      const AntennaRecord looks = antenna_record(body, radar, 1, c, 1e-12, rng);
      const double power = looks.power[1];
      sum += power / records, squares += power * power / records;
      over_carriers += looks.speckle.value().over_carriers.value() * power * power / records;
      over_frames = std::max(over_frames, looks.speckle->over_frames);
    }
    INFO(step_mhz << " MHz");
    CHECK(sum == Approx(1).margin(4.5 * std::sqrt(expected / records)));
    const double one_over_looks = squares / (sum * sum) - 1;
    CHECK(one_over_looks == Approx(expected).epsilon(4.5 * std::sqrt(6.0 / records)));
    // The variance over carriers, by N - 1: N / (N - 1) (1 - expected).
    CHECK(over_carriers == Approx(4.0 / 3 * (1 - expected)).epsilon(0.25));
    CHECK(over_frames < 1e-4);  // nothing moves
  }
}

TEST_CASE("what stands still is another sum at each carrier, and the same in each frame") {
  Conditions c = stone(3);
  c.radar_frames = 13;
  Returns wall = slab();
  for (auto& place : wall.place) place.person = Returns::still;
  Rng rng(3);
  AntennaRadar radar = radar_of(c, 700);
  AntennaEcho echo(wall, radar, c, rng);
  Samples at(echo.samples());
  std::vector<Complex> first;
  for (const std::size_t frame : {0u, 1u})
    for (std::size_t k = 0; k < 3; ++k) {
      echo.set_carrier(k);
      echo.frame(0.05, rng, at);
      if (frame == 0)
        first.push_back(at[1]);
      else
        check_near(first[k], at[1], 1e-6);
    }
  CHECK(std::abs(first[0] - first[1]) > 0.05);
  CHECK(std::abs(first[0] - first[2]) > 0.05);
  // As one point it is as strong at each, 4 pi R df / c later.
  Returns point = points({{0, 0, 1, 0}}, {3.5}, {1});
  AntennaEcho one(point, radar, c, rng);
  one.frame(0.05, rng, at);
  const Complex before = at[1];
  one.set_carrier(2);
  one.frame(0.05, rng, at);
  const double later = -4 * pi * 3.5 * radar.carriers_hz[2] / speed_of_light_m_s;
  check_near(at[1], before * std::polar(1.0, later), 2e-3 * std::abs(before));
}

TEST_CASE("echoes that do not interfere vary by noise alone, with antennas or without") {
  Plan plan;
  plan.people = 1, plan.letters = 0;
  plan.conditions.radar_frames = 100;
  const Generator plain(plan);
  const auto record = plain.make(0);
  REQUIRE(record.speckle);
  CHECK(record.array.empty());
  CHECK_FALSE(record.speckle->over_carriers);
  // The variance of a frame's noise in each point, by the squares of the mean powers.
  const Conditions& c = plan.conditions;
  const double rms = profile_noise(c, mean_peak_power(radar_response(c), c), 1);
  double squares = 0, fourths = 0;
  for (const float power : record.radar)
    squares += std::pow(power + rms, 2), fourths += std::pow(power + rms, 4);
  const double expected = rms * rms * squares / fourths;
  CHECK(record.speckle->over_frames == Approx(expected).epsilon(0.25));
  plan.conditions.radar_sum = "coherent";
  const auto moving = Generator(plan).make(0);
  CHECK(moving.array.empty());
  CHECK(moving.speckle.value().over_frames > 0.15);
  plan.conditions.radar_carriers = 4;
  const auto hopping = Generator(plan).make(0);
  CHECK(hopping.speckle.value().over_frames < moving.speckle->over_frames);
  CHECK(hopping.speckle->over_carriers.value() > 0.3);
}
