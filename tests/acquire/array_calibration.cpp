// SPDX-License-Identifier: MIT
// Tests the calibration of the radar antennas with simulated frames of known gains and phases.
#include "acquire/calibrate/array_calibration.hpp"

#include <complex>

#include "acquire/config/calibration.hpp"
#include "acquire/config/config.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;

namespace {

constexpr std::size_t bins = 16, reflector = 4;
constexpr double turn = 2 * std::numbers::pi;

struct World {
  std::vector<double> gain{1, 0.8, 1.25, 1, 0.9, 1.1, 1, 0.7};
  std::vector<double> phase{0, 0.4, -2.9, 3.1, 1.5, -0.3, 0.02, 2.2};
  // `noise` is the standard deviation of the noise in each of the real and imaginary parts.
  double amplitude = 2000, noise = 60;
  // Amplitude of a second wave, arriving from the side, relative to that of the first wave.
  double second_wave = 0;
  double drift_rad = 0.05;  // phase drift per frame, the same for all antennas
};

std::vector<std::int16_t> frame_of(const World& w, std::mt19937& rng, std::size_t number) {
  std::normal_distribution<double> part(0, w.noise);
  std::vector<std::int16_t> out;
  const auto n = static_cast<double>(number);
  for (std::size_t b = 0; b < bins; ++b)
    for (std::size_t m = 0; m < w.gain.size(); ++m) {
      std::complex<double> x(part(rng), part(rng));
      const double side = std::numbers::pi * 0.5 * static_cast<double>(m) + 0.8 * n;
      if (b == reflector)
        x += w.amplitude * std::polar(w.gain[m], w.phase[m]) *
             (std::polar(1.0, w.drift_rad * n) + std::polar(w.second_wave, side));
      out.push_back(static_cast<std::int16_t>(std::lround(x.imag())));
      out.push_back(static_cast<std::int16_t>(std::lround(x.real())));
    }
  return out;
}

ArrayFrames frames_of(const World& w, std::size_t count, std::uint32_t seed) {
  std::mt19937 rng(seed);
  ArrayFrames frames;
  for (std::size_t i = 0; i < count; ++i) frames.push_back(frame_of(w, rng, i));
  return frames;
}

std::string refusal(const ArrayFrames& frames, std::size_t bin = reflector) {
  return fit_antennas(frames, 8, bin).refusal;
}

}  // namespace

TEST_CASE("antenna calibration recovers the gains and phases within their standard errors") {
  const World w;
  double squares = 0;
  int values = 0;
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    const AntennaFit fit = fit_antennas(frames_of(w, 40, seed), 8, reflector + seed % 3 - 1);
    REQUIRE(fit.refusal.empty());
    CHECK(fit.gains.gain[0] == Approx(1));
    CHECK(fit.gains.phase_rad[0] == 0);
    for (std::size_t m = 1; m < 8; ++m) {
      const double error = fit.gains.standard_error[m];
      const double phase = std::remainder(fit.gains.phase_rad[m] - w.phase[m], turn);
      const double gain = std::log(fit.gains.gain[m] / w.gain[m]);
      CHECK(error < 0.01);
      CHECK(std::max(std::abs(phase), std::abs(gain)) < 5 * error);
      squares += (phase * phase + gain * gain) / (error * error);
      values += 2;
    }
  }
  CHECK(squares / values == Approx(1).margin(0.15));
}

TEST_CASE("antenna calibration is refused without a peak, with two waves or with a dead antenna") {
  World w;
  CHECK(refusal(frames_of(w, 7, 1)) == "fewer than 8 frames with antenna samples received");
  CHECK(has(refusal(frames_of(w, 20, 1), 9), "no peak in the antenna samples at the reflector: "));
  w.second_wave = 0.8;
  CHECK(has(refusal(frames_of(w, 20, 1)), "more than one echo: "));
  w.second_wave = 0;
  w.gain[5] = 0;
  CHECK(has(refusal(frames_of(w, 20, 1)), "the gain of antenna 5 relative to antenna 0 is -"));
  w.gain[5] = 1, w.noise = 0;
  const AntennaFit fit = fit_antennas(frames_of(w, 20, 1), 8, reflector);
  // Without noise, the standard error still includes the error caused by rounding the samples to
  // integers.
  CHECK(fit.gains.standard_error[3] > 1e-4);
  CHECK(refusal(ArrayFrames(20, std::vector<std::int16_t>(bins * 16))) != "");
}

TEST_CASE("antenna calibration reports larger standard errors if repeated measurements differ") {
  const World w;
  AntennaGains all = fit_antennas(frames_of(w, 80, 3), 8, reflector).gains;
  const AntennaGains before = all;
  std::vector<AntennaGains> repeats;
  for (std::uint32_t k = 0; k < 8; ++k)
    repeats.push_back(fit_antennas(frames_of(w, 10, 50 + k), 8, reflector).gains);
  widen(all, repeats);
  CHECK(all.standard_error[2] == before.standard_error[2]);
  for (std::uint32_t k = 0; k < 8; ++k) {
    repeats[k].phase_rad[2] += k % 2 ? 0.3 : -0.3;
    repeats[k].gain[5] *= std::exp(k % 2 ? 0.2 : -0.2);
  }
  widen(all, repeats);
  CHECK(all.standard_error[2] == Approx(0.3 / std::sqrt(7.0)).epsilon(0.1));
  CHECK(all.standard_error[5] == Approx(0.2 / std::sqrt(7.0)).epsilon(0.1));
  CHECK(all.standard_error[3] == before.standard_error[3]);
  CHECK(largest_residual(all, before) == 0);
  AntennaGains slipped = before;
  slipped.phase_rad[3] += turn + 7 * before.standard_error[3];
  CHECK(largest_residual(slipped, before) == Approx(7 / std::sqrt(2.0)));
}

TEST_CASE("antenna positions of the radar board are combined with the calibrated gains") {
  const Folder folder;
  const std::string path = folder / "lab.toml", radar = source_dir + "/config/radar/";
  fs::copy_file(radar + "xwr68xx_azimuth_50cm.cfg", folder / "azimuth.cfg");
  fs::copy_file(radar + "xwr68xx_paper_50cm.cfg", folder / "paper.cfg");
  write_file(path,
             "[radar]\ncli = \"serial:/a\"\ndata = \"serial:/b\"\ncfg = \"azimuth.cfg\"\n"
             "[run]\ncalibration = \"c.toml\"\n");
  Calibration c;
  c.entries = {{Sensor::radar, "2026", "some method", 1, -0.0375, 2e-4}};
  AntennaGains& gains = c.antennas;
  gains.gain = {1, 2, 1, 1, 1, 1, 1, 3}, gains.phase_rad = {0, 1, 2, 3, 1, 1, 1, 1};
  gains.standard_error.assign(8, 0);
  write_calibration(folder / "c.toml", c);
  const Config config = load_config(path);
  REQUIRE(config.antennas.size() == 8);
  CHECK(config.antennas[7] == record::Antenna{7, 0, 3, 1});
  CHECK(config.antennas[1] == record::Antenna{1, 0, 2, 1});
  const Config aop = load_config(path, {"radar.board=aop"});
  REQUIRE(aop.antennas.size() == 8);
  CHECK(aop.antennas[4] == record::Antenna{1, 3, 1, 1});
  CHECK(load_config(path, {"radar.cfg=paper.cfg"}).antennas.empty());
  CHECK(has(error_of([&] { load_config(path, {"radar.board=boost"}); }).second, "radar.board"));
  for (auto* list : {&gains.gain, &gains.phase_rad, &gains.standard_error}) list->resize(4);
  write_calibration(folder / "c.toml", c);
  CHECK(has(error_of([&] { load_config(path); }).second,
            "c.toml: contains gains for 4 antennas, but the heat map of radar.cfg and radar.board "
            "has 8"));
}
