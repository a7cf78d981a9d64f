// SPDX-License-Identifier: MIT
#include "acquire/calibrate/response_fit.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>

#include "drivers/core/axis.hpp"
#include "drivers/core/log2_codes.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse;
using namespace echofuse::acquire;

namespace {

constexpr double pi = std::numbers::pi, step_ps = 10;
constexpr std::size_t bins = 2000;

// Photons of a reflector at 1 m; a share of them has an exponential tail.
std::vector<std::uint32_t> photons(int count, double fwhm_ps, double tail_ps, double share,
                                   Rng& rng) {
  std::vector<std::uint32_t> counts(bins);
  std::normal_distribution<double> time(ps_per_m, fwhm_ps / std::sqrt(8 * std::numbers::ln2));
  std::exponential_distribution<double> delay(tail_ps > 0 ? 1 / tail_ps : 1);
  std::bernoulli_distribution delayed(tail_ps > 0 ? share : 0);
  for (int n = 0; n < count; ++n) {
    const double t = time(rng) + (delayed(rng) ? delay(rng) : 0);
    ++counts[static_cast<std::size_t>(t / step_ps)];
  }
  for (int n = 0; n < count / 10; ++n) ++counts[rng() % bins];
  return counts;
}

constexpr unsigned antennas = 12;
const EchoAxis axis{
    .step_m = 0.044, .resolution_m = 0.0469, .log2_power_step = log2_power_step(antennas)};

// Frames of a reflector at 1.01 m through the window 1 + a cos + b cos, by the sum over its
// samples.
std::vector<std::vector<std::uint16_t>> frames(double a, double b, double noise_db, Rng& rng) {
  constexpr unsigned samples = 120;
  std::vector<std::complex<double>> clean(64);
  for (std::size_t i = 0; i < clean.size(); ++i) {
    const double cells = (static_cast<double>(i) * axis.step_m - 1.01) / axis.resolution_m;
    for (unsigned k = 0; k < samples; ++k) {
      const double x = 2 * pi * (k + 0.5) / samples - pi;
      clean[i] +=
          (1 + a * std::cos(x) + b * std::cos(2 * x)) * std::polar(1.0 / samples, x * cells);
    }
  }
  clean[0] += 30, clean[1] += 10;  // the transmitter's own leakage
  std::normal_distribution<double> noise(0, std::pow(10, noise_db / 20) / std::sqrt(2));
  std::vector<std::vector<std::uint16_t>> out(100);
  for (auto& frame : out)
    for (const auto& c : clean) {
      double sum = 0;
      for (unsigned n = 0; n < antennas; ++n)
        sum += std::log2(1e6 * std::abs(c + std::complex(noise(rng), noise(rng))));
      frame.push_back(static_cast<std::uint16_t>(std::lround(256 * sum / 16)));
    }
  return out;
}

}  // namespace

TEST_CASE("an impulse response is found with its tail, within its errors") {
  Rng rng = make_rng(1, 1);
  const Search search{1, 0.3};
  for (const double fwhm_ps : {120., 200., 280.}) {
    record::Response plain, tailed;
    fit_impulse_response(photons(50'000, fwhm_ps, 0, 0, rng), 0, step_ps, search, plain);
    CHECK(std::abs(plain.irf_fwhm_ps.value - fwhm_ps) < 4 * plain.irf_fwhm_ps.standard_error);
    CHECK(plain.irf_fwhm_ps.standard_error < 2);
    CHECK(plain.irf_tail_share.value == 0);
    fit_impulse_response(photons(50'000, fwhm_ps, 150, 0.4, rng), 0, step_ps, search, tailed);
    INFO(to_text(tailed.irf_fwhm_ps) << ", " << to_text(tailed.irf_tail_ps));
    CHECK(std::abs(tailed.irf_fwhm_ps.value - fwhm_ps) < 4 * tailed.irf_fwhm_ps.standard_error);
    CHECK(std::abs(tailed.irf_tail_ps.value - 150) < 4 * tailed.irf_tail_ps.standard_error);
    CHECK(std::abs(tailed.irf_tail_share.value - 0.4) < 4 * tailed.irf_tail_share.standard_error);
  }
  record::Response none;
  fit_impulse_response(photons(500, 200, 0, 0, rng), 0, step_ps, search, none);
  CHECK(none == record::Response{});
}

TEST_CASE("the radar's response is that of the window over its sweep") {
  Rng rng = make_rng(2, 1);
  struct Case {
    double a, b, width_cells;  // full width of the power at half (Harris)
  };
  for (const auto& [a, b, width] :
       {Case{0, 0, 0.89}, {0.46 / 0.54, 0, 1.30}, {1, 0, 1.44}, {0.5 / 0.42, 0.08 / 0.42, 1.64}}) {
    record::Response found;
    fit_radar_response(frames(a, b, -35, rng), axis, 1.01, found);
    REQUIRE(found.radar.known());
    CHECK(found.radar.width_m() / found.radar.cell_m == Approx(width).margin(0.02));
    CHECK(found.taps_standard_error < 0.01);
    CHECK(found.radar.taps[0] == 1);
    CHECK(found.radar.cell_m == axis.resolution_m);
  }
}

TEST_CASE("the noise of independent frames falls with the root of their number") {
  Rng rng = make_rng(3, 1);
  record::Response found;
  fit_noise_exponent(frames(0, 0, -20, rng), axis.log2_power_step, found);
  CHECK(std::abs(found.radar_noise_exponent.value + 0.5) <
        5 * found.radar_noise_exponent.standard_error);
  CHECK(found.radar_noise_exponent.standard_error < 0.05);
  record::Response few;
  fit_noise_exponent(std::vector(20, std::vector<std::uint16_t>(64, 7)), axis.log2_power_step, few);
  CHECK(few == record::Response{});
}

TEST_CASE("what a run states of its response is read back, and what cannot be is not known") {
  record::Response r;
  r.irf_fwhm_ps = {203.5, 1.25}, r.irf_tail_ps = {90, 4}, r.irf_tail_share = {0.4, 0.02};
  r.radar = {0.05, {1, 0.75, 0.25, 0.0625}}, r.taps_standard_error = 0.0125;
  r.radar_noise_exponent = {-0.5, 0.01};
  CHECK(record::response_of(r.meta()) == r);
  CHECK(record::response_of({}) == record::Response{});
  for (const char* taps :
       {"", "1", "1 0.5", "0.9 0.5 0.1", "1 x 0.1", "1 0.5 -0.1", "1 0.5 nan", "1 0.5 0.1 +- x"})
    CHECK_FALSE(record::response_of({{"radar_cell_m", "0.5"}, {"radar_taps", taps}}).radar.known());
  CHECK_FALSE(record::response_of({{"radar_taps", "1 0.5 0.1"}}).radar.known());
  // A cubic through the roots of the taps meets a sinc in between.
  record::RadarResponse sinc{2, {}};
  for (int k = 0; k < 24; ++k)
    sinc.taps.push_back(k == 0 ? 1 : std::pow(std::sin(pi * k / 4) / (pi * k / 4), 2));
  for (double u = 0; u < 0.9; u += 0.05)
    CHECK(sinc.amplitude(u) == Approx(u == 0 ? 1 : std::sin(pi * u) / (pi * u)).margin(0.02));
  CHECK(sinc.width_m() == Approx(2 * 0.886).margin(0.01));
}
