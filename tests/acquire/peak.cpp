// SPDX-License-Identifier: MIT
#include "acquire/calibrate/peak.hpp"

#include "echoes.hpp"

using namespace echofuse::acquire;
using namespace echofuse::test;

namespace {

Peak spd(const std::vector<std::uint32_t>& counts, Search search = {}) {
  return fit_photons(counts, 0, step_ps, search);
}

const EchoAxis fine{.step_m = 0.044, .resolution_m = 0.0469};

Profiles frames(const std::vector<Echo>& echoes, double noise_db, std::size_t count, Rng& rng) {
  return frames_of(echoes, fine, noise_db, count, rng);
}

int trials() { return std::getenv("ECHOFUSE_LONG") ? 1000 : 200; }

// Collects the ratios of errors to their standard errors. The mean and the mean square of the
// ratios must match Student's t distribution within 4.5 standard errors. At most 1 % of the ratios
// may exceed 3.
struct Pulls {
  std::vector<double> all;
  double worst_m = 0;
  void add(const Peak& p, double true_m) {
    REQUIRE(p.refusal == "");
    all.push_back((p.range_m - true_m) / p.standard_error_m);
    worst_m = std::max(worst_m, std::abs(p.range_m - true_m));
  }
  // `degrees` is the number of degrees of freedom of the standard error.
  void check(double degrees) const {
    const auto n = static_cast<double>(all.size());
    double sum = 0, squares = 0, beyond = 0;
    for (const double z : all) {
      sum += z;
      squares += z * z;
      beyond += std::abs(z) > 3;
    }
    const double variance = degrees / (degrees - 2);
    const double kurtosis = 3 + 6 / (degrees - 4);
    CAPTURE(sum / n, squares / n, beyond / n);
    CHECK(std::abs(sum / n) < 4.5 * std::sqrt(variance / n));
    CHECK(std::abs(squares / n - variance) < 4.5 * variance * std::sqrt((kurtosis - 1) / n));
    CHECK(beyond <= 0.01 * n + (n < 1000 ? 2 : 0));
  }
};

}  // namespace

TEST_CASE("the scatter of fitted SPD peak positions matches their standard errors") {
  Rng rng = make_rng(1, 0);
  std::uniform_real_distribution<double> place(0.95, 1.05);
  Pulls pulls;
  for (int i = 0; i < trials(); ++i) {
    const double true_m = place(rng);
    pulls.add(spd(photons({{true_m, 2000}}, 1000, rng)), true_m);
  }
  pulls.check(1e6);
  CHECK(pulls.worst_m < 2e-3);
}

TEST_CASE("the scatter of fitted radar peak positions matches their standard errors") {
  // For the weakest echo (noise at -15 dB), averaging the logarithms of the power would cause a
  // bias larger than the standard error.
  const auto [noise_db, count] =
      GENERATE(table<double, std::size_t>({{-40, 20}, {-25, 40}, {-15, 100}}));
  Rng rng = make_rng(2, 0);
  std::uniform_real_distribution<double> place(0.95, 1.05);
  Pulls pulls;
  for (int i = 0; i < trials(); ++i) {
    const double true_m = place(rng);
    pulls.add(fit_echo(frames({{true_m, 1}}, noise_db, count, rng), fine, {}), true_m);
  }
  CAPTURE(noise_db);
  pulls.check(static_cast<double>(count) - 1);
  CHECK(pulls.worst_m < 1e-2);
}

TEST_CASE("the standard error of a radar peak in identical frames comes from quantisation") {
  Rng rng = make_rng(4, 0);
  // Peaks midway between two bins are avoided, because two bins that are equal in every frame would
  // count as a clipped lobe.
  std::uniform_real_distribution<double> place(22.6 * fine.step_m, 23.4 * fine.step_m);
  constexpr int count = 100;
  double squares = 0;
  for (int i = 0; i < count; ++i) {
    const double true_m = place(rng);
    const Peak peak = fit_echo(frames({{true_m, 1}}, -100, 8, rng), fine, {});
    CAPTURE(true_m, peak.refusal, peak.range_m, peak.standard_error_m);
    const double pull = (peak.range_m - true_m) / peak.standard_error_m;
    CHECK(std::abs(pull) < 3);
    CHECK(peak.standard_error_m < 2e-4);
    squares += pull * pull;
  }
  CHECK(squares / count == Approx(1).margin(0.4));
}

TEST_CASE("a second reflector in the radar lobe is detected or shifts the peak by less than 1 cm") {
  Rng rng = make_rng(5, 0);
  std::uniform_real_distribution<double> place(0.97, 1.03);
  int noticed = 0;
  for (const double amplitude : {0.3, 0.5, 1.0})
    for (const double apart_m : {-0.14, -0.1, -0.07, 0.07, 0.1, 0.14})
      for (int i = 0; i < 20; ++i) {
        const double true_m = place(rng), angle = 2 * pi * place(rng) * 20;
        const Peak peak = fit_echo(
            frames({{true_m, 1}, {true_m + apart_m, std::polar(amplitude, angle)}}, -30, 10, rng),
            fine, {});
        CAPTURE(amplitude, apart_m, angle, true_m, peak.refusal);
        noticed += !peak.refusal.empty();
        if (peak.refusal.empty()) CHECK(std::abs(peak.range_m - true_m) < 1e-2);
      }
  CHECK(noticed > 180);
}

TEST_CASE("a peak fit refuses data without a reflector peak and reports the reason") {
  Rng rng = make_rng(3, 0);
  using Catch::StartsWith;
  using Reflectors = std::vector<std::pair<double, double>>;
  for (const auto& [reflectors, background, words] :
       {std::tuple(Reflectors{}, 20, "no peak: fewer than 100 photons"),
        {{}, 20'000, "SNR too low"},
        {{{1.5, 5000}},
         1000,
         "no peak in the search window; the strongest peak is at 1.500 m: check "
         "--distance; if a cable or fibre delays the clicks, add -33"},
        {{{1, 5000}, {1.07, 3000}}, 1000, "two peaks: the second peak is at 1.0"}})
    CHECK_THAT(spd(photons(reflectors, background, rng)).refusal, StartsWith(words));
  // Echoes outside the search range are ignored, however strong they are.
  const Peak before_a_wall = spd(photons({{1, 5000}, {1.3, 20'000}}, 1000, rng));
  CHECK(before_a_wall.refusal == "");
  CHECK(before_a_wall.range_m == Approx(1).margin(2e-3));
  const auto radar = [&](const std::vector<Echo>& echoes, double noise_db, Search search = {}) {
    return fit_echo(frames(echoes, noise_db, 20, rng), fine, search).refusal;
  };
  CHECK_THAT(fit_echo({}, fine, {}).refusal, StartsWith("no peak: fewer than 8 frames"));
  CHECK_THAT(radar({{1, 1}}, 0), StartsWith("SNR too low"));
  CHECK_THAT(radar({{1.3, 1}}, -30), StartsWith("no peak in the search window"));
  CHECK_THAT(radar({{1, 1}, {1.4, 0.8}}, -30, {1, 1}), StartsWith("two peaks: the second peak is"));
  auto flat = frames({{1, 1}}, -30, 20, rng);
  for (auto& frame : flat)
    for (auto& power : frame) power = std::min(power, radar::power_from_code(3700, antennas));
  CHECK_THAT(fit_echo(flat, fine, {}).refusal, StartsWith("saturated"));
}
