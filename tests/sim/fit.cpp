// SPDX-License-Identifier: MIT
#include "sim/fit/fit.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "drivers/core/random.hpp"
#include "scenes.hpp"
#include "sim/dataset/dataset.hpp"
#include "sim/fit/regression.hpp"
#include "sim/fit/sensor_fit.hpp"
#include "sim/scene/draw.hpp"
#include "sim/scene/room.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/sensors/render.hpp"

using namespace echofuse;
using namespace echofuse::sim;

namespace {

Conditions coarse() {
  Conditions c;
  c.spd_rays = 96;
  c.radar_rays = 96;
  return c;
}

std::vector<record::FusedRecord> run_of(const Conditions& nominal, std::int64_t laboratory,
                                        std::int64_t people, std::int64_t letters,
                                        std::int64_t empty = 0) {
  Plan plan;
  plan.conditions = nominal;
  plan.people = people;
  plan.letters = letters;
  plan.empty = empty;
  plan.seed = 77;
  if (laboratory >= 0) plan.twin = to_text(twin_named("default"));
  plan.laboratory = std::max<std::int64_t>(0, laboratory);
  const Generator generator(plan);
  std::vector<record::FusedRecord> records;
  for (std::int64_t i = 0; i < generator.records(); ++i) records.push_back(generator.make(i));
  return records;
}

Surface seen(const Scene& scene, const Conditions& c, bool letter) {
  const record::MapGrid grid = map_grid(c);
  return surface_of(render_depth_mm(scene, grid.x(), grid.y()), {}, grid, letter);
}

}  // namespace

TEST_CASE("patches of a depth map send back what a wall does") {
  const Conditions c;
  Scene scene;
  scene.plates = {{{0, 0, 4}, {0.8, 0, 0.6}, {0, 1, 0}, {{-0.5, 0, 0.5, 0, 1}}, 1}};
  const Surface s = seen(scene, c, false);
  double light = 0;
  for (const SurfacePatch& p : s.patches) light += p.weight / (p.x * p.x + p.y * p.y + p.z * p.z);
  const Returns exact = spd_returns(scene, c);
  double expected = 0;
  for (const double w : exact.weight) expected += w * mean_scene_weight;
  CHECK(light == Approx(expected).epsilon(0.06));
  CHECK(s.area == Approx(0.8).epsilon(0.06));
  CHECK(s.top == Approx(0.5).margin(0.07));
  CHECK(std::abs(s.x) < 0.05);
  CHECK(seen(Scene{}, c, false).patches.empty());
}

TEST_CASE("a letter is parted from who holds it, and the room from people") {
  const Conditions c;
  const Scene scene = make_scene(c, SceneKind::letter, 1, 2);
  const Surface s = seen(scene, c, true);
  CHECK(s.plate_gap > 0.3);
  CHECK(s.plate_gap < 0.8);
  CHECK(s.plate_area > 0.02);
  const record::MapGrid grid = map_grid(c);
  Scene room;
  room.room = &sim::room();
  Scene both = scene;
  both.room = &sim::room();
  const auto empty = render_depth_mm(room, grid.x(), grid.y());
  const Surface there = surface_of(render_depth_mm(both, grid.x(), grid.y()), empty, grid, true);
  CHECK(there.patches.size() == s.patches.size());
}

TEST_CASE("the response is found from what the patches render") {
  const Conditions c;
  Rng rng(5);
  ResponseFit fit(c);
  for (int record = 0; record < 10; ++record) {
    Returns returns;
    std::vector<double> rendered(static_cast<std::size_t>(c.bins));
    for (int k = 0; k < 12; ++k) {
      const auto bin = 80 + rng() % 40;
      rendered[bin] += 100;
      returns.range_m.push_back((c.first_bin_ps + (static_cast<double>(bin) + 0.5) * 100) /
                                ps_per_m);
      returns.weight.push_back(100 / c.signal_photons);
    }
    Conditions there = c;
    there.irf_fwhm_ps = 280;
    there.irf_tail_ps = 150;
    there.irf_tail_share = 0.3;
    there.spd_delay_ps = 0;
    fit.add(rendered, spd_rate(returns, there));
  }
  const auto found = fit.solve();
  CHECK(found.sigma_ps == Approx(280 / 2.3548).epsilon(0.05));
  CHECK(found.tail_share == Approx(0.3).margin(0.05));
  CHECK(std::abs(found.delay_ps) < 20);
}

TEST_CASE("bias and width of the radar are found from one noise-free profile") {
  Conditions c = coarse();
  const Conditions stated = c;
  c.radar_bias_m = 0.03;
  c.radar_psf_width = 1.08;
  c.radar_plate = 2;
  const Scene scene = make_scene(c, SceneKind::letter, 1, 2);
  const auto power = radar_power(radar_returns(scene, c), radar_response(c), c);
  const EchoFit fit = fit_echo(seen(scene, c, true), power, stated);
  CHECK(fit.width == Approx(0.08).margin(0.03));
  CHECK(fit.noise < 0.02 * fit.peak);
  Conditions unbiased = c;
  unbiased.radar_bias_m = 0;
  const EchoFit straight =
      fit_echo(seen(scene, c, true),
               radar_power(radar_returns(scene, unbiased), radar_response(c), c), stated);
  CHECK(fit.shift_m - straight.shift_m == Approx(0.03).margin(0.003));
  CHECK(std::abs(straight.shift_m) < 0.03);  // a coarse map, and what only the radar sees
  const Scene base = make_scene(stated, SceneKind::letter, 1, 2);
  const auto before = radar_power(radar_returns(base, c), radar_response(c), c);
  const EchoFit once = fit_echo(seen(base, c, true), before, stated);
  CHECK(fit.plate / fit.body == Approx(2 * once.plate / once.body).epsilon(0.2));
}

TEST_CASE("a regression's error is that of laboratories left out") {
  Rng rng(3);
  int within = 0;
  for (int trial = 0; trial < 50; ++trial) {
    Eigen::MatrixXd x(60, 5);
    Eigen::VectorXd y(60), at(5);
    double truth = 1;
    for (Eigen::Index j = 0; j < 5; ++j) at[j] = uniform(rng, -1, 1);
    truth += 2 * at[0] - at[1];
    for (Eigen::Index i = 0; i < 60; ++i) {
      for (Eigen::Index j = 0; j < 5; ++j) x(i, j) = uniform(rng, -1, 1);
      y[i] = 1 + 2 * x(i, 0) - x(i, 1) + uniform(rng, -0.3, 0.3);
    }
    const Prediction p = predict(x, y, at);
    CHECK(p.standard_error > 0.12);
    CHECK(p.standard_error < 0.26);
    within += std::abs(p.value - truth) < p.standard_error;
  }
  CHECK(within >= 45);  // the error is of a noisy y, the truth has none
}

TEST_CASE("a run of a laboratory tells it within its errors, and becomes a twin") {
  FitOptions options;
  options.nominal = coarse();
  options.laboratories = 80;
  options.records = 20;
  options.quiet = true;
  constexpr std::int64_t laboratory = 1003;
  const auto records = run_of(options.nominal, laboratory, 10, 30, 2);
  const Fit fit = fit_twin(records, options);
  CHECK(fit.used == 40);
  CHECK(fit.empty.records == 2);
  const Twin prior = twin_named("default");
  const Conditions truth = conditions_of(prior, laboratory, options.nominal);
  int told = 0, within = 0;
  for (const Estimate& e : fit.estimates) {
    if (!e.told) {
      CHECK_FALSE(e.reason.empty());
      continue;
    }
    INFO(e.name << " " << e.value << " +- " << e.standard_error << ", " << truth_of(e, truth));
    ++told;
    const double was = truth_of(e, truth);
    const double off = e.logarithmic ? std::log(e.value / was) : e.value - was;
    CHECK(std::abs(off) < 4.5 * e.standard_error);
    within += std::abs(off) < 3 * e.standard_error;
  }
  CHECK(told >= 6);
  CHECK(within >= told - 1);
  const Twin twin = read_twin(twin_of(fit, "monday.sqlite"), "fitted");
  CHECK(twin.ranges.size() == prior.ranges.size());
  const std::string report = report_of(fit);
  for (const Estimate& e : fit.estimates) {
    CHECK(report.find("\n" + e.name) != std::string::npos);
    if (!e.told || !e.is_key) continue;
    const auto range = std::find_if(twin.ranges.begin(), twin.ranges.end(),
                                    [&](const Range& r) { return r.key == e.name; });
    REQUIRE(range != twin.ranges.end());
    CHECK(range->low <= e.value);
    CHECK(e.value <= range->high);
  }
}

TEST_CASE("a fit asks for ten records of one person") {
  FitOptions options;
  options.nominal = coarse();
  options.quiet = true;
  CHECK_THROWS_AS(fit_twin(run_of(options.nominal, -1, 9, 0, 3), options), Error);
}
