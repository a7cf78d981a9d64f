// SPDX-License-Identifier: MIT
#include "acquire/calibrate/response_fit.hpp"

#include "echoes.hpp"

using namespace echofuse::acquire;
using namespace echofuse::test;

namespace {

// Bin width, size of the resolution cell and range of the reflector, all in m.
struct Place {
  double step_m, cell_m, range_m;
  EchoAxis axis() const { return {.step_m = step_m, .resolution_m = cell_m}; }
};
constexpr Place fine{0.044, 0.0469, 1.01};

std::function<double(double)> kaiser(double b) {
  return [b](double t) { return std::cyl_bessel_i(0, b * std::sqrt(std::max(0., 1 - 4 * t * t))); };
}
const NamedWindow windows[] = {
    {"none", cosines({1})},
    {"Hann", cosines({1, 1})},
    blackman_window,
    {"Kaiser 2.5", kaiser(2.5)},
    {"Kaiser 6", kaiser(6)},
    {"Kaiser 12", kaiser(12)},
    // Taylor window with 5 nearly equal sidelobes
    {"Taylor, 35 dB", cosines({1, .6887, -.03039, .008557, -.001469})},
    {"Gauss", [](double t) { return std::exp(-t * t / .08); }},
    {"Blackman-Harris", cosines({.35875, .48829, .14128, .01168})},
    {"flat top", cosines({.21557895, .41663158, .277263158, .083578947, .006947368})},
};

// Returns 100 range profiles of a reflector and of an object behind it, with transmitter leakage.
Profiles frames(const NamedWindow& window, const Place& place, double noise_db, Rng& rng,
                bool adds = false, const Echo& behind = {0, 0}) {
  const Echo echoes[] = {{place.range_m}, {place.range_m + behind.range_m, behind.amplitude}};
  return frames_of({std::begin(echoes), std::end(echoes)}, place.axis(), noise_db, 100, rng, window,
                   3, adds);
}

}  // namespace

TEST_CASE("the fit of the detector response recovers width and tail within their standard errors") {
  Rng rng = make_rng(2, 1);
  const Search search{1, 0.3};
  const std::vector<std::pair<double, double>> one{{1, 50'000}};
  for (const double fwhm_ps : {120., 200., 280.}) {
    record::Response plain, tailed;
    fit_impulse_response(photons(one, 5000, rng, fwhm_ps), 0, step_ps, search, plain);
    CHECK(std::abs(plain.irf_fwhm_ps.value - fwhm_ps) < 4 * plain.irf_fwhm_ps.standard_error);
    CHECK(plain.irf_fwhm_ps.standard_error < 2);
    CHECK(plain.irf_tail_share.value == 0);
    fit_impulse_response(photons(one, 5000, rng, fwhm_ps, 150, 0.4), 0, step_ps, search, tailed);
    INFO(to_text(tailed.irf_fwhm_ps) << ", " << to_text(tailed.irf_tail_ps));
    CHECK(std::abs(tailed.irf_fwhm_ps.value - fwhm_ps) < 4 * tailed.irf_fwhm_ps.standard_error);
    CHECK(std::abs(tailed.irf_tail_ps.value - 150) < 4 * tailed.irf_tail_ps.standard_error);
    CHECK(std::abs(tailed.irf_tail_share.value - 0.4) < 4 * tailed.irf_tail_share.standard_error);
  }
  record::Response none;
  CHECK(fit_impulse_response(photons({{1, 500}}, 50, rng), 0, step_ps, search, none) ==
        "fewer than 1000 photons received");
  CHECK(none == record::Response{});
}

TEST_CASE("the response fit finds the radar's range response for any window function") {
  Rng rng = make_rng(2, 1);
  for (const Place& place : {fine, Place{0.25, 0.27, 1.76}, Place{0.25, 0.27, 3}})
    for (const auto& [noise_db, adds] : {std::pair{-35., false}, {-20., false}, {-16., true}})
      for (const NamedWindow& window : windows) {
        CAPTURE(place.range_m, noise_db, window.name);
        record::Response found;
        const WindowFit fit = fit_radar_response(frames(window, place, noise_db, rng, adds),
                                                 place.axis(), place.range_m, found);
        REQUIRE(fit.refusal == "");
        REQUIRE(found.radar.known());
        CHECK(found.radar.taps[0] == 1);
        CHECK(std::abs(fit.lopsided.value) < 0.02);
        CHECK(found.radar.cell_m == place.cell_m);
        CHECK(found.taps_standard_error < (noise_db < -30 ? 0.02 : 0.04));
        for (std::size_t k = 0; k < found.radar.taps.size(); ++k) {
          const double tap = std::norm(response(window, static_cast<double>(k) / 4));
          CAPTURE(k, tap, found.radar.taps[k], found.taps_standard_error);
          CHECK(std::abs(found.radar.taps[k] - tap) < 4 * found.taps_standard_error);
        }
      }
}

TEST_CASE("the response fit refuses an echo that the transmitter leakage overlaps") {
  Rng rng = make_rng(3, 1);
  for (const double range_m : {0.5, 1.01, 1.5})
    for (const NamedWindow& window : windows) {
      const Place place{0.25, 0.27, range_m};
      record::Response found;
      const WindowFit fit =
          fit_radar_response(frames(window, place, -20, rng), place.axis(), range_m, found);
      CAPTURE(range_m, window.name);
      CHECK_THAT(fit.refusal, Catch::StartsWith("transmitter leakage overlaps"));
      CHECK(found == record::Response{});
    }
}

TEST_CASE("radar echoes are fitted with the measured window function") {
  Rng rng = make_rng(4, 1);
  for (const NamedWindow& window : windows)
    for (const double range_m : {1., 1.01, 1.022, 1.03}) {
      const Place place{fine.step_m, fine.cell_m, range_m};
      const auto all = frames(window, place, -30, rng);
      record::Response unused;
      const WindowFit fit = fit_radar_response(all, place.axis(), range_m, unused);
      const Peak peak = fit_echo(all, place.axis(), {}, fit.window);
      CAPTURE(window.name, range_m, peak.range_m);
      CHECK(peak.refusal == "");
      CHECK(peak.range_m == Approx(range_m).margin(1e-3));
    }
}

TEST_CASE("both flanks of an asymmetric radar response are fitted, and range zero is its peak") {
  Rng rng = make_rng(6, 1);
  for (const std::size_t name : {1u, 2u})
    for (const double cubic_rad : {4., 6., -6., 8.}) {
      const NamedWindow window{windows[name].name, windows[name].at, cubic_rad};
      const auto power = [&](double u) { return std::norm(response(window, u)); };
      double peak = 0, greatest = 0;
      for (double u = -1; u <= 1; u += 1e-3)
        if (power(u) > power(peak)) peak = u;
      for (double u = 0.25; u < 4; u += 0.25)
        if (const double odd = (power(peak + u) - power(peak - u)) / power(peak);
            std::abs(odd) > std::abs(greatest))
          greatest = odd;
      for (const Place& place : {fine, Place{0.25, 0.27, 3}}) {
        const auto all = frames(window, place, -35, rng);
        record::Response found;
        const double true_m = place.range_m + peak * place.cell_m;
        const WindowFit fit = fit_radar_response(all, place.axis(), true_m, found);
        CAPTURE(window.name, cubic_rad, place.range_m, fit.refusal);
        REQUIRE(found.radar.known());
        REQUIRE(found.radar.taps.size() == 31);
        CHECK(std::abs(fit.lopsided.value - greatest) < 0.015);
        CHECK(std::abs(fit.lopsided.value) > 4 * fit.lopsided.standard_error);
        const Peak echo = fit_echo(all, place.axis(), {true_m, 2 * place.cell_m}, fit.window);
        CHECK(echo.refusal == "");
        CHECK(std::abs(echo.range_m - true_m) < 0.015 * place.cell_m);
        for (int k = -15; k <= 15; ++k)
          CHECK(found.radar.taps[static_cast<std::size_t>(k + 15)] ==
                Approx(power(peak + k / 4.) / power(peak)).margin(0.03));
        CHECK(record::response_of(found.meta()).radar.peak() == 15);
      }
    }
}

TEST_CASE("the response fit refuses an extended reflector and reports the reason") {
  Rng rng = make_rng(5, 1);
  const auto refusal = [&](const Place& place, const Echo& behind) {
    record::Response found;
    const auto fit = fit_radar_response(frames(blackman_window, place, -35, rng, false, behind),
                                        place.axis(), place.range_m, found);
    CHECK(found == record::Response{});
    return fit.refusal;
  };
  CHECK_THAT(refusal(fine, {0.08, std::polar(0.5, 1.)}),
             Catch::Contains("does not match that of a single point"));
  CHECK_THAT(
      refusal({0.25, 0.27, 0.5}, {0, 0}),
      Catch::Contains("at 1.6 m or farther, because the range cells of this cfg have 27 cm"));
  record::Response found;
  CHECK(fit_radar_response({}, fine.axis(), 1, found).refusal == "fewer than 8 frames received");
  // A wall behind the reflector is excluded from the fit.
  CHECK(fit_radar_response(frames(blackman_window, fine, -35, rng, false, {0.2, 5}), fine.axis(),
                           fine.range_m, found)
            .refusal == "");
  CHECK(found.radar.width_m() / found.radar.cell_m == Approx(1.64).margin(0.05));
}

TEST_CASE("radar noise falls with the square root of the number of independent frames") {
  Rng rng = make_rng(3, 1);
  record::Response found;
  fit_noise_exponent(frames(windows[0], fine, -20, rng), found);
  CHECK(std::abs(found.radar_noise_exponent.value + 0.5) <
        5 * found.radar_noise_exponent.standard_error);
  CHECK(found.radar_noise_exponent.standard_error < 0.05);
  record::Response few;
  CHECK(fit_noise_exponent(Profiles(20, std::vector<float>(64, 7)), few) ==
        "fewer than 40 frames received");
  CHECK(few == record::Response{});
}

TEST_CASE("the sensor responses of a run are read back, or are unknown if they are invalid") {
  record::Response r;
  r.irf_fwhm_ps = {203.5, 1.25}, r.irf_tail_ps = {90, 4}, r.irf_tail_share = {0.4, 0.02};
  r.radar = {0.05, {1, 0.75, 0.25, 0.0625}}, r.taps_standard_error = 0.0125;
  r.radar_noise_exponent = {-0.5, 0.01};
  CHECK(record::response_of(r.meta()) == r);
  CHECK(record::response_of({}) == record::Response{});
  const auto with_taps = [](const char* taps) {
    return record::response_of({{"radar_taps", taps}, {"radar_cell_m", "0.5"}}).radar;
  };
  for (const char* taps : {"", "1", "1 0.5", "0.9 0.5 0.1", "1 x 0.1", "1 0.5 -0.1", "1 0.5 nan",
                           "1 0.5 0.1 +- x", "0.2 0.9 0.5"})
    CHECK_FALSE(with_taps(taps).known());
  CHECK_FALSE(record::response_of({{"radar_taps", "1 0.5 0.1"}}).radar.known());
  const record::RadarResponse lopsided = with_taps("0 0.25 1 0.5 0.1");
  CHECK(lopsided.peak() == 2);
  CHECK(lopsided.power(-0.125) == Approx(0.25));
  CHECK(lopsided.power(0.125) == Approx(0.5));
  CHECK(lopsided.power(-0.4) == 0);
  CHECK(lopsided.power(0.25) == Approx(0.1));
  CHECK(with_taps("1 1.02 0.5").peak() == 0);
  // Cubic interpolation of the square roots of the taps approximates a sinc.
  record::RadarResponse sinc{2, {}};
  for (int k = 0; k < 24; ++k)
    sinc.taps.push_back(k == 0 ? 1 : std::pow(std::sin(pi * k / 4) / (pi * k / 4), 2));
  for (double u = 0; u < 0.9; u += 0.05)
    CHECK(sinc.amplitude(u) == Approx(u == 0 ? 1 : std::sin(pi * u) / (pi * u)).margin(0.02));
  CHECK(sinc.width_m() == Approx(2 * 0.886).margin(0.01));
}
