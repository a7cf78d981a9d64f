// SPDX-License-Identifier: MIT
// Tests the simulated motion of people in front of the radar antennas.

#include "antenna_scenes.hpp"
#include "drivers/core/axis.hpp"

using namespace echofuse::sim;

TEST_CASE("simulated body sway has a constant variance and the specified correlation in time") {
  Conditions c;
  c.radar_sway_m = 1;
  Rng rng(2);
  constexpr int draws = 4000;
  double before = 0, after = 0, both = 0;
  for (int i = 0; i < draws; ++i) {
    BodyMotion motion(c, 1, rng);
    const double a = motion.places()[0][0];
    motion.advance(0.2, rng);
    motion.advance(0.3, rng);
    const double b = motion.places()[0][0];
    before += a * a / draws, after += b * b / draws, both += a * b / draws;
  }
  CHECK(std::abs(before - 1) < 4.5 * std::sqrt(2.0 / draws));
  CHECK(std::abs(after - 1) < 4.5 * std::sqrt(2.0 / draws));
  // The correlation after a time t is (1 + w t) exp(-w t), which equals 2 / e for w t = 1.
  const double expected = 2 * std::exp(-1.0);
  CHECK(std::abs(both - expected) < 4.5 * std::sqrt((1 + expected * expected) / draws));
}

TEST_CASE("sway, twist and breathing of a body change the range by the computed amounts") {
  // The axis of the body is vertical and 3 m away. The patch is 0.2 m to the right of the axis.
  const double x = 0.2, z = 3, range = std::hypot(x, z);
  const auto modes = BodyMotion::range_per_mode(x / range, 0, 1.65, 0, z, 1);
  CHECK(modes[0] == Approx(x / range));
  CHECK(modes[1] == Approx(z / range));
  const double turned = std::hypot(x * std::cos(1e-4), z - x * std::sin(1e-4));
  CHECK(modes[2] == Approx((turned - range) / 1e-4).epsilon(1e-3));
  CHECK(modes[3] == 0);
  CHECK(BodyMotion::range_per_mode(0, 0, 1.25, 0, 3, 1)[3] == -1);
  // The feet of a body (height 0) do not sway.
  CHECK(BodyMotion::range_per_mode(0, 0, 0, 0, 3, 1)[1] == 0);
}

TEST_CASE("the number of independent speckle samples per record grows with body sway") {
  Conditions c = of_sum("coherent");
  const RadarAxis axis = radar_response(c);
  const Returns person = a_person(c, 2);
  const std::size_t peak = peak_of(person, c);
  // Returns the number of independent looks per record, estimated as mean^2 / variance of the peak
  // power.
  const auto looks_at = [&](double sway_m, double twist_deg, double breath_m) {
    c.radar_sway_m = sway_m, c.radar_twist_deg = twist_deg, c.radar_breath_m = breath_m;
    constexpr int records = 250;
    double sum = 0, squares = 0;
    Rng rng(5);
    for (int i = 0; i < records; ++i) {
      const double power =
          antenna_record(person, {axis, antennas_in_layout(1), 7}, 1, c, 1e-12, rng).power[peak];
      sum += power / records;
      squares += power * power / records;
    }
    return sum * sum / (squares - sum * sum);
  };
  const double none = looks_at(0, 0, 0), little = looks_at(0.001, 0, 0),
               natural = looks_at(0.005, 0.3, 0.004);
  INFO(none << " " << little << " " << natural);
  CHECK(std::abs(none - 1) < 0.5);
  CHECK(little > 1.1 * none);
  CHECK(natural > 2 * little);
}

TEST_CASE("motion during a chirp sequence changes antenna phases and reduces the echo power") {
  Conditions c = of_sum("coherent");
  c.radar_sway_m = c.radar_twist_deg = 0;
  // Breathing with an amplitude of 10 cm causes speeds of up to 16 cm/s.
  c.radar_breath_m = 0.1;
  AntennaRadar radar{radar_response(c), antennas_in_layout(8), 7};
  radar.chirp_s = 1e-3;
  radar.chirps = 16;
  const double later_s = 1e-6;
  const Returns chest = points({{0, 0, 1.25f, 0}}, {3.5}, {1});
  for (std::uint64_t seed = 1; seed < 6; ++seed) {
    Rng a(seed), b(seed), c_rng(seed);
    AntennaRadar at_once = radar;
    at_once.chirp_s = 0;
    AntennaEcho moving(chest, radar, c, a), standing(chest, at_once, c, b);
    BodyMotion motion(c, 1, c_rng);
    motion.advance(later_s, c_rng);
    Samples x(moving.samples()), y(standing.samples());
    moving.frame(later_s, a, x);
    standing.frame(later_s, b, y);
    const double wavelength = speed_of_light_m_s / radar_carrier_hz;
    // Rate at which the range changes, in m/s.
    const double v = -motion.speeds()[0][3];
    const double f = 2 * v * 2 * radar.chirp_s / wavelength;
    const double loss = std::sin(pi * f * 16) / (16 * std::sin(pi * f));
    const std::size_t peak = 14 * 8;
    for (std::size_t m = 0; m < 8; ++m) {
      const double late = m < 4 ? 0 : radar.chirp_s;
      const auto required =
          Complex(y[peak + m]) * loss * std::polar(1.0, -4 * pi * v * late / wavelength);
      check_near(Complex(x[peak + m]), required, 1e-3 * std::abs(Complex(y[peak])));
    }
  }
}
