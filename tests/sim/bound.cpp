// SPDX-License-Identifier: MIT
// The Cramer-Rao bound: against the spread of a maximum-likelihood estimate, against finer
// derivatives, and against the symmetry of the detector.
#include "sim/study/bound.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "scenes.hpp"
#include "sim/scene/draw.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"

using namespace echofuse;
using namespace echofuse::sim;

namespace {

double norm(const Values& a) {
  double sum = 0;
  for (const double v : a) sum += v * v;
  return std::sqrt(sum);
}
double difference(const Values& a, const Values& b) {
  Values d(a.size());
  std::transform(a.begin(), a.end(), b.begin(), d.begin(), std::minus<>());
  return norm(d);
}

// The inverse, column by column: M^-1 e_k by Gauss's elimination without pivots.
Values solve(Matrix m, Values b) {
  for (std::size_t i = 0; i < b.size(); ++i)
    for (std::size_t j = 0; j < b.size(); ++j) {
      if (j == i) continue;
      const double factor = m[j][i] / m[i][i];
      for (std::size_t k = i; k < b.size(); ++k) m[j][k] -= factor * m[i][k];
      b[j] -= factor * b[i];
    }
  for (std::size_t i = 0; i < b.size(); ++i) b[i] /= m[i][i];
  return b;
}

// A ball before both sensors. Parameters: x, z, and the gains of SPD and radar.
struct Ball {
  static constexpr std::int64_t rays = 48;
  Conditions conditions;
  RadarAxis axis;
  double sigma;

  Ball() : axis(radar_response(conditions)) {
    conditions.bins = 60;
    conditions.first_bin_ps = 19000;  // 2.85 m
    conditions.signal_photons = 3e4;
    conditions.background_counts = 400;
    sigma = profile_noise(conditions, mean_peak_power(axis, conditions), 60);
  }
  std::size_t bins() const { return static_cast<std::size_t>(conditions.bins); }

  // Mean counts, then the profile in units of its noise.
  Values mean(const Values& p) const {
    Scene scene;
    scene.capsules = {sphere({p[0], 0, p[1]}, 0.25, 0.8)};
    Values out = spd_rate(seen_by_spd(scene, conditions, rays), conditions);
    const double background = conditions.background_counts / static_cast<double>(bins());
    for (double& r : out) r = background + p[2] * (r - background);
    for (const double power : radar_power(seen_by_radar(scene, conditions, rays), axis))
      out.push_back(p[3] * power / sigma);
    return out;
  }
  Values whitened(const Values& p) const {
    Values out = mean(p);
    for (std::size_t i = 0; i < bins(); ++i) out[i] = 2 * std::sqrt(out[i]);
    return out;
  }

  // Fisher's scoring: p += M^-1 J^T (data - mean) / variance, from the truth.
  Values most_likely(const Values& data, Values p) const {
    for (int step = 0; step < 2; ++step) {
      const Values expected = mean(p);
      const Matrix j = slopes([this](const Values& q) { return mean(q); }, p, 1e-3);
      Matrix m(p.size(), Values(p.size()));
      Values score(p.size());
      for (std::size_t i = 0; i < data.size(); ++i) {
        const double variance = i < bins() ? expected[i] : 1;
        for (std::size_t a = 0; a < p.size(); ++a) {
          score[a] += j[a][i] * (data[i] - expected[i]) / variance;
          for (std::size_t b = 0; b < p.size(); ++b) m[a][b] += j[a][i] * j[b][i] / variance;
        }
      }
      const Values move = solve(m, score);
      for (std::size_t a = 0; a < p.size(); ++a) p[a] += move[a];
    }
    return p;
  }
};

double value_of(const std::vector<Bound>& rows, const std::string& axis, double value,
                const std::string& known) {
  for (const Bound& r : rows)
    if (r.axis == axis && r.value == value && r.known == known) return r.lateral_error_m;
  FAIL("no row " << axis << " " << value << " " << known);
  return 0;
}

}  // namespace

TEST_CASE("a maximum-likelihood estimate spreads as the bound says") {
  const Ball ball;
  const Values truth{0.4, 3.4, 1, 1};
  const Matrix j = slopes([&](const Values& p) { return ball.whitened(p); }, truth, 1e-3);
  const Values expected = ball.mean(truth);
  const double bound = least_deviation(information(j, 0, expected.size()), {1, 0, 0, 0});
  constexpr int draws = 500;
  Rng rng = make_rng(7, 0);
  std::normal_distribution<double> noise;
  double sum = 0, squares = 0;
  for (int n = 0; n < draws; ++n) {
    Values data = expected;
    for (std::size_t i = 0; i < data.size(); ++i)
      data[i] = i < ball.bins() ? static_cast<double>(poisson(data[i], rng)) : data[i] + noise(rng);
    const double error = ball.most_likely(data, truth)[0] - truth[0];
    sum += error;
    squares += error * error;
  }
  const double spread = std::sqrt((squares - sum * sum / draws) / (draws - 1));
  INFO("bound " << bound << " m, spread " << spread << " m, mean error " << sum / draws << " m");
  CHECK(bound > 0.002);
  CHECK(bound < 0.1);
  CHECK(spread == Approx(bound).epsilon(3 / std::sqrt(2.0 * draws)));  // three standard errors
  CHECK(std::abs(sum / draws) < 4 * bound / std::sqrt(draws));
}

TEST_CASE("the bound of a straight line is that of least squares") {
  // y = a + b t at t = 0..9, unit noise: var b = 12 / (n (n^2 - 1)), var a = (4n - 2)/(n (n + 1)).
  const Model line = [](const Values& p) {
    Values y;
    for (int t = 0; t < 10; ++t) y.push_back(p[0] + p[1] * t);
    return y;
  };
  const Matrix m = information(slopes(line, {1, 2}, 0.1), 0, 10);
  CHECK(least_deviation(m, {0, 1}) == Approx(std::sqrt(12 / 990.0)));
  CHECK(least_deviation(m, {1, 0}) == Approx(std::sqrt(38 / 110.0)));
  CHECK(std::isinf(least_deviation({{1, 1}, {1, 1}}, {1, 0})));
  CHECK(std::isinf(least_deviation({{0}}, {1})));
}

TEST_CASE("rays that follow the body see what the data set's rays see") {
  Conditions c;
  c.spd_rays = c.radar_rays = 2048;
  for (std::uint64_t i = 0; i < 4; ++i) {
    const Scene scene = some_scene(c, i);
    const Values wide = spd_rate(spd_returns(scene, c), c);
    const Seen spd = seen_by_spd(scene, c, 512);
    CHECK(difference(spd_rate(spd, c), wide) < 2e-3 * norm(wide));
    const RadarAxis axis = radar_response(c);
    const Values power = radar_power(radar_returns(scene, c), axis);
    CHECK(difference(radar_power(seen_by_radar(scene, c, 512), axis), power) < 2e-3 * norm(power));
    CHECK(spd.z_m > 2.5);
    CHECK(spd.z_m < 4.5);
    CHECK(seen_by_spd(mirrored(scene), c, 512).tangent == Approx(-spd.tangent).margin(1e-3));
  }
}

TEST_CASE("derivatives converge with step and rays, and keep the detector's symmetry") {
  const Conditions c;
  const auto kind = GENERATE(SceneKind::person, SceneKind::letter);
  const bool letter = kind == SceneKind::letter;
  CAPTURE(letter);
  const Rng rng = make_rng(3, 0);
  SceneSampler sampler(rng);
  make_scene(c, kind, sampler);
  const auto draws = sampler.draws();
  const auto range = [&](std::size_t draw) { return draws[draw].high - draws[draw].low; };
  const auto slope = [&](std::size_t draw, double step, std::int64_t rays) {
    const Model model = [&](const Values& at) {
      Values moves(draw + 1);
      moves[draw] = at[0] * range(draw);
      SceneSampler moved(rng, moves);
      Values out = spd_rate(seen_by_spd(make_scene(c, kind, moved), c, rays), c);
      for (double& r : out) r = 2 * std::sqrt(r);
      return out;
    };
    return slopes(model, {0}, step)[0];
  };
  if (!letter)
    for (const std::size_t draw : {1u, 2u, 8u}) {  // z, turn, a leg's swing
      CAPTURE(draw);
      const Values fine = slope(draw, 0.00125, 1536);
      const auto error = [&](double step, std::int64_t rays) {
        return difference(slope(draw, step, rays), fine) / norm(fine);
      };
      const double chosen = error(0.0025, 512);  // the study's
      CHECK(chosen < 0.07);
      CHECK(error(0.02, 512) > 2 * chosen);
      CHECK(error(0.0025, 96) > 2 * chosen);
    }
  // The turn of a letter is counted from the line of sight.
  const Values x = slope(0, 0.0025, 512), z = slope(1, 0.0025, 512), turn = slope(2, 0.0025, 512);
  const double radian = letter ? 0 : 180 / std::acos(-1);
  Values predicted(x.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    predicted[i] = range(0) / draws[1].value *
                   (draws[0].value * z[i] / range(1) + radian / range(2) * turn[i]);
  CHECK(difference(predicted, x) < 0.05 * norm(x));
}

TEST_CASE("the bound falls with signal and baseline, and the less is known the higher it is") {
  BoundOptions options;
  options.scenes = 4;
  options.rays = 128;
  options.quiet = true;
  const auto rows = study_bound(options);
  for (const std::string known : {"shape", "pose"}) {
    const auto at = [&](const char* axis, double value) {
      return value_of(rows, axis, value, known);
    };
    CHECK(at("base", 0) == Approx(at("snr_db", 20)).epsilon(1e-9));
    CHECK(at("base", 0) == Approx(at("photons", 1e5)).epsilon(1e-9));
    CHECK(at("base", 0) == Approx(at("baseline_m", 0.5)).epsilon(1e-9));
    CHECK(at("base", 0) == Approx(at("resolution_m", 0.5)).epsilon(1e-9));
    CHECK(at("snr_db", 30) < 0.5 * at("snr_db", 20));
    CHECK(at("photons", 1e2) > 1.1 * at("photons", 1e5));
    CHECK(at("baseline_m", 0.1) > 2 * at("baseline_m", 0.5));
    CHECK(at("baseline_m", 2) < 0.6 * at("baseline_m", 0.5));
    CHECK(at("resolution_m", 1) > 1.3 * at("resolution_m", 0.5));
  }
  for (const char* axis : {"snr_db", "photons", "baseline_m", "resolution_m"})
    for (const Bound& r : rows)
      if (r.axis == axis && r.known == "pose" && r.value <= 1e5 && r.lateral_error_m < 0.1)
        CHECK(r.lateral_error_m > 0.99 * value_of(rows, axis, r.value, "shape"));
  CHECK(value_of(rows, "base", 0, "shape") > 0.005);
  CHECK(value_of(rows, "base", 0, "shape") < 0.03);
}

TEST_CASE("the bound refuses conditions with another noise") {
  const auto refused = [](void (*change)(Conditions&)) {
    BoundOptions options;
    change(options.conditions);
    CHECK_THROWS_AS(study_bound(options), Error);
  };
  refused([](Conditions& c) { c.pulses_per_window = 1000; });
  refused([](Conditions& c) { c.radar_sum = "coherent"; });
  refused([](Conditions& c) { c.signal_photons = 0; });
  refused([](Conditions& c) { c.target_x_m = 0; });
}
