// SPDX-License-Identifier: MIT
#include "sim/sensors/radar_echo.hpp"

#include "../catch.hpp"
#include "drivers/core/axis.hpp"
#include "scenes.hpp"

using namespace echofuse::sim;

namespace {

constexpr double pi = std::numbers::pi;

double decibel(double amplitude) { return 20 * std::log10(std::abs(amplitude)); }

// Returns the normalised Fourier transform of a continuous Blackman window of unit length, computed
// by summation.
double blackman_by_sum(double u) {
  constexpr int n = 20'000;
  double sum = 0, norm = 0;
  for (int k = 0; k < n; ++k) {
    const double t = (k + 0.5) / n - 0.5;
    const double window = 0.42 + 0.5 * std::cos(2 * pi * t) + 0.08 * std::cos(4 * pi * t);
    sum += window * std::cos(2 * pi * u * t);
    norm += window;
  }
  return sum / norm;
}

}  // namespace

TEST_CASE("the sinc radar response has nulls at multiples of the resolution c / 2B") {
  constexpr double bandwidth_hz = 300e6;
  RadarAxis axis;
  axis.resolution_m = speed_of_light_m_s / (2 * bandwidth_hz);
  axis.step_m = axis.resolution_m / 2;
  const Returns point{{10 * axis.step_m}, {2.5}};
  const auto power = radar_power(point, axis);
  CHECK(power[10] == Approx(2.5).epsilon(1e-12));
  CHECK(power[11] == Approx(2.5 * std::pow(2 / pi, 2)).epsilon(1e-9));
  for (const std::size_t null : {0u, 2u, 4u, 6u, 8u, 12u, 14u, 16u, 28u})
    CHECK(power[null] == Approx(0).margin(1e-20));
}

TEST_CASE("an asymmetric radar response is simulated and stated with both flanks") {
  const auto psf_of = [&](const std::string& taps) {
    Conditions c;
    c.radar_taps = taps;
    validate(c);
    const record::RadarResponse stated = stated_response(c).radar;
    const Psf psf = radar_response(c).psf;
    for (const double u : {-1.25, -0.5, -0.25, 0., 0.75})
      CHECK(std::sqrt(stated.power(u * stated.cell_m)) == Approx(psf.at(u)).margin(1e-9));
    return psf;
  };
  const Psf even = psf_of("1 0.81 0.41 0.09 0"),
            same = psf_of("0 0.09 0.41 0.81 1 0.81 0.41 0.09 0"),
            near = psf_of("0 0.3 0.7 1 0.8 0.2 0"), far = psf_of("0 0.2 0.8 1 0.7 0.3 0");
  CHECK(near.at(0.25) > near.at(-0.25));
  for (double u = -1.5; u < 1.5; u += 0.1) {
    CHECK(same.at(u) == Approx(even.at(u)).margin(1e-9));
    CHECK(near.at(u) == Approx(far.at(-u)).margin(1e-9));
  }
}

TEST_CASE("the Blackman radar response is the Fourier transform of the Blackman window") {
  for (const double u : {0.0, 0.3, 0.8, 0.99999, 1.0, 1.5, 2.0, 2.0000001, 2.5, 3.0, 3.4, 7.7})
    CHECK(Psf::blackman().at(u) == Approx(blackman_by_sum(u)).margin(1e-7));
  double half = 0;
  while (decibel(Psf::blackman().at(half)) > 10 * std::log10(0.5)) half += 1e-5;
  CHECK(std::abs(decibel(blackman_by_sum(half)) - 10 * std::log10(0.5)) < 1e-3);
  // The half-power width, 2 * half, is 1.64 bins.
  CHECK(std::lround(200 * half) == 164);
  double highest = -INFINITY;
  for (double u = 3.0001; u < 50; u += 1e-3)
    highest = std::max(highest, decibel(Psf::blackman().at(u)));
  CHECK(highest < -58);
  CHECK(highest > -59);
}

TEST_CASE("a simulated range profile equals the sum over scatterers at each bin") {
  const Returns returns{{2.9, 3.33, 3.47, 5.0}, {0.5, 1.0, 0.3, 0.2}};
  for (const Psf& psf : {Psf::sinc(), Psf::blackman(), Psf::hann()}) {
    const RadarAxis axis{0.1, 0.25, 29, 0.5, psf};
    const auto power = radar_power(returns, axis);
    for (std::uint32_t i = 0; i < axis.count; ++i) {
      double expected = 0;
      for (std::size_t k = 0; k < returns.weight.size(); ++k) {
        const double a = psf.at((0.1 + 0.25 * i - returns.range_m[k]) / 0.5);
        expected += returns.weight[k] * a * a;
      }
      CHECK(power[i] == Approx(expected).epsilon(0).margin(2e-4));
    }
  }
}

TEST_CASE(
    "antenna leakage gives an echo at range 0, or at the range bias of the radar if positive") {
  for (const auto& [bias_m, range_m] : {std::pair{0., 0.}, {0.4, 0.4}, {-0.4, 0.}}) {
    Conditions c;
    c.radar_leakage = 3, c.radar_bias_m = bias_m;
    const RadarAxis axis = radar_response(c);
    const auto power = radar_power(radar_returns({}, c), axis);
    for (std::uint32_t i = 0; i < axis.count; ++i)
      CHECK(power[i] == Approx(3 * std::pow(Psf::sinc().at(i * 0.5 - range_m / 0.5), 2))
                            .margin(range_m > 0 ? 1e-3 : 1e-20));
  }
}

TEST_CASE("the radar measures range from its own position") {
  Scene scene;
  scene.capsules = {sphere({0.8, 0, 3.5}, 0.1)};
  const Conditions c;
  const auto nearest = [&](const Scene& s) {
    const Returns r = radar_returns(s, c);
    return *std::min_element(r.range_m.begin(), r.range_m.end());
  };
  // Ray directions differ by 1/160 (tangent), so the rays may miss the point of the sphere nearest
  // to the radar by at most this range, in m.
  const double miss = std::pow(4.0 / 160, 2) / 2 * (1 / 0.1 + 1 / 3.5) / 2;
  CHECK(nearest(scene) >= std::hypot(1.3, 3.5) - 0.1 - 1e-6);
  CHECK(nearest(scene) <= std::hypot(1.3, 3.5) - 0.1 + miss);
  CHECK(nearest(mirrored(scene)) >= std::hypot(0.3, 3.5) - 0.1 - 1e-6);
  CHECK(nearest(mirrored(scene)) <= std::hypot(0.3, 3.5) - 0.1 + miss);
}

TEST_CASE("simulated radar noise is white and falls with the square root of the number of frames") {
  Conditions c;
  c.radar_snr_db = 13;
  constexpr double mean_peak = 0.7;
  const auto frames = GENERATE(std::int64_t{60}, std::int64_t{15}, std::int64_t{240});
  std::vector<double> power(40'000, 5.0);
  Rng rng = make_rng(1, 2);
  add_profile_noise(power, mean_peak, c, frames, rng);
  const double sigma = mean_peak * std::pow(10, -1.3) * std::sqrt(60 / static_cast<double>(frames));
  double sum = 0, squares = 0, neighbours = 0;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double z = (power[i] - 5) / sigma;
    sum += z;
    squares += z * z;
    if (i > 0) neighbours += z * (power[i - 1] - 5) / sigma;
  }
  const double n = static_cast<double>(power.size());
  CHECK(std::abs(sum) < 4.5 * std::sqrt(n));
  // The mean over frames of an exponentially distributed variable has a kurtosis of 3 + 6 / frames.
  CHECK(std::abs(squares - n) < 4.5 * std::sqrt((2 + 6 / static_cast<double>(frames)) * n));
  CHECK(std::abs(neighbours) < 4.5 * std::sqrt(n));
}

TEST_CASE("the reference peak power equals the mean peak power of simulated scenes") {
  const Conditions c;
  const RadarAxis axis = radar_response(c);
  const double reference = mean_peak_power(axis, c);
  CHECK(mean_peak_power(axis, c) == reference);
  constexpr int scenes = 300;
  double sum = 0, squares = 0;
  for (std::uint64_t i = 0; i < scenes; ++i) {
    const auto kind = i % 4 == 0 ? SceneKind::person : SceneKind::letter;
    const auto power = radar_power(radar_returns(make_scene(c, kind, 8, i), c), axis);
    const double peak = *std::max_element(power.begin(), power.end());
    sum += peak;
    squares += peak * peak;
  }
  const double mean = sum / scenes, variance = squares / scenes - mean * mean;
  CHECK(std::abs(mean - reference) < 3.5 * std::sqrt(variance * (1.0 / scenes + 1.0 / 64)));
}
