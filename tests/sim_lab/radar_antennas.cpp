// SPDX-License-Identifier: MIT
#include "sim/devices/radar_antennas.hpp"

#include <complex>

#include "../catch.hpp"
#include "sim/sensors/radar_echo.hpp"

using namespace echofuse::sim;

namespace {

constexpr double pi = std::numbers::pi;
using Complex = std::complex<double>;

// range step for a slope of 18.75 MHz/us, which the chip rounds to 517 frequency steps
constexpr double bin_m = 0.25022102542;

// Returns a chirp that results in a range profile of 64 bins.
Chirp chirp_of(std::vector<unsigned> transmitters) {
  Chirp chirp;
  chirp.samples = 60;
  chirp.sample_rate_ksps = 2000;
  chirp.slope_mhz_us = 18.75;
  chirp.receivers = 0xf;
  chirp.transmitters = std::move(transmitters);
  chirp.antennas = static_cast<unsigned>(4 * chirp.transmitters.size());
  return chirp;
}

// Returns a scene with a point echo of power 1 in bin 12. The echo arrives as a plane wave from the
// direction given by the sines x and y.
RenderedScene point_at(double x, double y, std::int64_t index = 0) {
  RenderedScene scene;
  scene.index = index;
  scene.radar = {.range_m = {12 * bin_m},
                 .weight = {1.0},
                 .place = {{static_cast<float>(x), static_cast<float>(y), 1, Returns::leakage}}};
  return scene;
}

std::vector<Complex> samples_of(const RadarTlv& tlv) {
  const auto parts = to_values<std::int16_t>(tlv.payload);
  std::vector<Complex> samples;
  for (std::size_t i = 0; i < parts.size(); i += 2) samples.emplace_back(parts[i + 1], parts[i]);
  return samples;
}

Conditions quiet(const char* sum = "incoherent") {
  Conditions c;
  c.radar_snr_db = 100;
  c.radar_sum = sum;
  return c;
}

}  // namespace

TEST_CASE("the simulated linear array sends eight antenna samples for two or three transmitters") {
  const Conditions c = quiet();
  for (const auto& transmitters : {std::vector<unsigned>{0, 2}, std::vector<unsigned>{0, 2, 1}}) {
    RadarAntennas board(c, 3);
    board.start(chirp_of(transmitters), 1);
    Rng rng(1);
    board.sample_frame(point_at(0.25, 0.5), 0, 1, rng);
    const RadarTlv tlv = board.tlv();
    CHECK(tlv.type == 4);
    const auto samples = samples_of(tlv);
    REQUIRE(samples.size() == 64 * 8);
    for (int m = 0; m < 8; ++m)
      CHECK(std::abs(samples[12 * 8 + static_cast<std::size_t>(m)] -
                     std::polar(1024.0, pi * m * 0.25)) < 1);
  }
}

TEST_CASE("the simulated planar array sends samples of all antennas with their channel errors") {
  Conditions c = quiet();
  c.radar_antennas = 12;
  c.radar_phase_error_rad = 0.4;
  c.radar_gain_error_db = 1;
  RadarAntennas board(c, 3);
  board.start(chirp_of({0, 1, 2}), 1);
  Rng rng(1);
  board.sample_frame(point_at(-0.1, 0.2), 0, 4, rng);
  const RadarTlv tlv = board.tlv();
  CHECK(tlv.type == 8);
  const auto samples = samples_of(tlv);
  REQUIRE(samples.size() == 64 * 12);
  const auto antennas = simulated_antennas(c, 3);
  for (std::size_t m = 0; m < 12; ++m) {
    const auto& a = antennas[m];
    CHECK(std::abs(samples[12 * 12 + m] -
                   std::polar(2048 * a.gain, pi * (-0.1 * a.x + 0.2 * a.y) + a.phase_rad)) < 1.5);
  }
  // The coefficients reported by the firmware must compensate for the channel errors.
  std::istringstream words(board.coefficients());
  double re = 0, im = 0, first = 0;
  for (std::size_t m = 0; words >> re >> im; ++m) {
    const Complex left = Complex(re, im) * std::polar(antennas[m].gain, antennas[m].phase_rad);
    if (m == 0) first = left.real();
    CHECK(std::abs(left - first) < 1e-4);
  }
  CHECK(first > 0);
}

TEST_CASE("range profile codes of coherent echoes match the antenna samples") {
  const Conditions c = quiet("coherent");
  RadarAntennas board(c, 3);
  board.start(chirp_of({0, 2}), 1);
  Rng rng(1);
  board.sample_frame(point_at(0.25, 0), 0, 1, rng);
  const auto codes = board.profile_codes();
  REQUIRE(codes.size() == 64);
  // The magnitude of the echo is 2^20, so the code is 256 * 20.
  CHECK(std::abs(codes[12] - 256 * 20) <= 1);
  const auto samples = samples_of(board.tlv());
  CHECK(std::abs(codes[13] - 256 * (10 + std::log2(std::abs(samples[13 * 8])))) < 2);
}

TEST_CASE("radar speckle changes with each new scene and is kept while a scene is unchanged") {
  const Conditions c = quiet("coherent");
  RadarAntennas board(c, 3);
  board.start(chirp_of({0, 2}), 1);
  Rng rng(1);
  RenderedScene person = point_at(0, 0);
  person.radar.place[0].person = 0;
  const auto peak = [&](std::int64_t scene, double time_s) {
    person.index = scene;
    board.sample_frame(person, time_s, 1, rng);
    return samples_of(board.tlv())[12 * 8];
  };
  const Complex first = peak(0, 10), again = peak(0, 10), later = peak(0, 11), other = peak(1, 11);
  CHECK(std::abs(again - first) < 2);
  // The echo comes from a single point, so only its phase changes with time.
  CHECK(std::abs(std::abs(later) - std::abs(first)) < 2);
  CHECK(std::abs(later - first) > 2);
  CHECK(std::abs(std::abs(other) - std::abs(first)) > 2);
}
