// SPDX-License-Identifier: MIT
// Tests the simulated radar antennas, and the motion of people in front of them.
#include "sim/sensors/antennas.hpp"

#include <complex>

#include "../catch.hpp"
#include "drivers/core/axis.hpp"
#include "scenes.hpp"
#include "sim/dataset/generator.hpp"
#include "sim/sensors/gaussian.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"

using namespace echofuse::sim;

namespace {

constexpr double pi = std::numbers::pi;
using Complex = std::complex<double>;
using Samples = std::vector<std::complex<float>>;

Conditions of_sum(const char* sum) {
  Conditions c;
  c.radar_antennas = 8;
  c.radar_sum = sum;
  return c;
}

Returns points(std::initializer_list<Returns::PatchOrigin> places, std::vector<double> ranges,
               std::vector<double> weights) {
  return {.range_m = std::move(ranges), .weight = std::move(weights), .place = places};
}

void check_near(Complex a, Complex b, double margin) {
  INFO(a << " " << b);
  CHECK(std::abs(a - b) < margin);
}

Returns a_person(const Conditions& c, std::uint64_t index) {
  return radar_returns(make_scene(c, SceneKind::person, 5, index), c);
}

std::size_t peak_of(const Returns& returns, Conditions c) {
  c.radar_sum = "incoherent";
  const auto power = radar_power(returns, radar_response(c));
  return static_cast<std::size_t>(std::max_element(power.begin(), power.end()) - power.begin());
}

Complex wave(const record::Antenna& a, double x, double y = 0) {
  return std::polar(a.gain, pi * (a.x * x + a.y * y) + a.phase_rad);
}

}  // namespace

TEST_CASE("antenna samples of a point target contain the steering phases and the channel errors") {
  for (const char* sum : {"incoherent", "coherent"})
    for (const std::int64_t antennas : {8, 12}) {
      Conditions c = of_sum(sum);
      c.radar_antennas = antennas;
      c.radar_phase_error_rad = 0.5;
      c.radar_gain_error_db = 1;
      const RadarAxis axis = radar_response(c);
      const auto array = simulated_antennas(c, 3);
      CHECK(array[1].phase_rad != 0);
      const Returns point =
          points({{0.25f, -0.125f, 1, Returns::reflector}}, {14.2 * axis.step_m}, {4});
      Rng rng(1);
      AntennaEcho echo(point, {axis, array, 7}, c, rng);
      Samples samples(echo.samples());
      for (int frame = 0; frame < 2; ++frame) {
        echo.frame(0.05, rng, samples);
        for (std::size_t i = 0; i < axis.count; ++i)
          for (std::size_t m = 0; m < array.size(); ++m) {
            const double u = (static_cast<double>(i) - 14.2) * axis.step_m / axis.resolution_m;
            const auto seen = samples[i * array.size() + m];
            check_near(seen, 2 * axis.psf.at(u) * wave(array[m], 0.25, -0.125), 1e-4);
          }
      }
      CHECK(stated_antennas(array, c) == array);
      c.radar_array_calibrated = false;
      CHECK(stated_antennas(array, c) == antennas_in_layout(array.size()));
    }
}

TEST_CASE(
    "virtual antenna positions of the AOP board are sums of transmitter and receiver positions") {
  const auto a = antennas_in_layout(12);
  CHECK((a[0].x == 1 && a[0].y == 1));
  CHECK((a[5].x == 3 && a[5].y == 2));
  CHECK((a[11].x == 0 && a[11].y == 2));
}

TEST_CASE(
    "the covariance of incoherent echoes over consecutive frames equals that of the sources") {
  const Conditions c = of_sum("incoherent");
  const RadarAxis axis = radar_response(c);
  const auto array = simulated_antennas(c, 3);
  const Returns two =
      points({{0.2f, 0, 1, 0}, {-0.3f, 0, 1, Returns::still}}, {3.5, 4.1}, {1, 0.5});
  Rng rng(1);
  AntennaEcho echo(two, {axis, array, 7}, c, rng);
  Samples samples(echo.samples());
  for (int before = 0; before < 17; ++before) echo.frame(0.05, rng, samples);
  record::ArrayStatistics sums(axis.count, 8);
  for (std::int64_t f = 0; f < c.radar_frames; ++f) {
    echo.frame(0.05, rng, samples);
    sums.add(samples);
  }
  const auto kept = sums.take();
  for (const std::size_t i : {13u, 14u, 16u}) {
    const auto bin = record::bin_of(kept, 8, i);
    const double at = static_cast<double>(i) * axis.step_m;
    const auto power = [&](double range, double w) {
      return w * std::pow(axis.psf.at((at - range) / axis.resolution_m), 2);
    };
    const double first = power(3.5, 1), second = power(4.1, 0.5);
    for (std::size_t m = 0; m < 8; ++m)
      for (std::size_t n = 0; n < 8; ++n) {
        const double apart = pi * (static_cast<double>(m) - static_cast<double>(n));
        check_near(bin.covariance(m, n),
                   first * std::polar(1.0, apart * 0.2) + second * std::polar(1.0, -apart * 0.3),
                   2e-4);
      }
    CHECK(std::abs(bin.lag()) < 0.05 * bin.power());
  }
}

TEST_CASE("simulated antenna noise is complex and white and has the specified power") {
  Conditions c = of_sum("coherent");
  constexpr double noise = 0.3;
  Rng rng(4);
  const RadarAxis axis = radar_response(c);
  const auto looks =
      antenna_record({}, {axis, antennas_in_layout(8), 7}, axis.count, c, noise, rng);
  const auto bins = static_cast<double>(axis.count), frames = static_cast<double>(c.radar_frames);
  double power = 0, across = 0, mean = 0, lag = 0;
  for (std::size_t i = 0; i < axis.count; ++i) {
    const auto bin = record::bin_of(looks.array, 8, i);
    power += bin.power() / 8 / bins;
    lag += std::norm(bin.lag()) / bins;
    CHECK(looks.power[i] == Approx(bin.power() / 8).epsilon(1e-5));
    for (std::size_t m = 0; m < 8; ++m) {
      mean += std::norm(bin.mean(m)) / 8 / bins;
      for (std::size_t n = 0; n < m; ++n) across += std::norm(bin.covariance(m, n)) / 28 / bins;
    }
  }
  // The power of a single sample is exponentially distributed, so the mean of n samples has a
  // relative standard deviation of 1 / sqrt(n).
  CHECK(std::abs(power / noise - 1) < 4.5 / std::sqrt(8 * frames * bins));
  CHECK(std::abs(mean * frames / noise - 1) < 4.5 / std::sqrt(8 * bins));
  CHECK(std::abs(across * frames / (noise * noise) - 1) < 4.5 * 2 / std::sqrt(28 * bins));
  CHECK(std::abs(lag * (frames - 1) / (8 * noise * noise) - 1) < 4.5 * 2 / std::sqrt(bins));
}

TEST_CASE("the fast Gaussian generator has the moments and tails of a normal distribution") {
  Rng rng(9);
  std::vector<float> x(400'001);
  add_gaussian(x, 2, rng);
  double second = 0, fourth = 0, sum = 0;
  int beyond = 0, last = 0;
  for (const double v : x) {
    sum += v / 2;
    second += v * v / 4;
    fourth += v * v * v * v / 16;
    beyond += std::abs(v) > 2 * 2;
    // Counts the values that exceed 3.6 standard deviations. The standard deviation is 2.
    last += std::abs(v) > 2 * 3.6;
  }
  const double n = static_cast<double>(x.size());
  CHECK(std::abs(sum / n) < 4.5 / std::sqrt(n));
  CHECK(std::abs(second / n - 1) < 4.5 * std::sqrt(2 / n));
  CHECK(std::abs(fourth / n - 3) < 4.5 * std::sqrt(96 / n));
  const double two = 0.0455003, far = 3.18217e-4;
  CHECK(std::abs(beyond - two * n) < 4.5 * std::sqrt(two * n));
  CHECK(std::abs(last - far * n) < 4.5 * std::sqrt(far * n));
}

TEST_CASE("speckle power has an exponential distribution, and its mean is the incoherent sum") {
  Conditions c = of_sum("coherent");
  const RadarAxis axis = radar_response(c);
  const auto array = antennas_in_layout(8);
  const Returns person = a_person(c, 0);
  const std::size_t peak = peak_of(person, c);
  // The expected values are sums over patches, whereas the simulation sums over cells that each
  // combine several patches.
  double power = 0;
  Complex ends;
  for (std::size_t k = 0; k < person.range_m.size(); ++k) {
    const double u =
        (static_cast<double>(peak) * axis.step_m - person.range_m[k]) / axis.resolution_m;
    const double w = person.weight[k] * std::pow(axis.psf.at(u), 2);
    power += w;
    ends += std::polar(w, pi * 7 * person.place[k].x);
  }
  constexpr int draws = 3000;
  double sum = 0, squares = 0;
  Complex across;
  Rng rng(6);
  for (int d = 0; d < draws; ++d) {
    AntennaEcho echo(person, {axis, array, 7}, c, rng);
    Samples samples(echo.samples());
    echo.frame(0, rng, samples);
    const Complex first = samples[peak * 8], last = samples[peak * 8 + 7];
    sum += std::norm(first) / power;
    squares += std::norm(first) * std::norm(first) / (power * power);
    across += last * std::conj(first) / (power * draws);
  }
  CHECK(std::abs(sum / draws - 1) < 4.5 / std::sqrt(draws) + 0.01);
  CHECK(std::abs(squares / draws - 2) < 4.5 * std::sqrt(20.0 / draws) + 0.04);
  check_near(across, ends / power, 4.5 / std::sqrt(draws) + 0.02);
}

TEST_CASE("the radar echo of an empty room is equal in each record except for shadows") {
  Conditions c = of_sum("coherent");
  c.background = "room";
  c.radar_leakage = 3;
  const RadarAxis axis = radar_response(c);
  const auto array = antennas_in_layout(8);
  const auto frame_of = [&](const Scene& scene, std::uint64_t seed, std::uint64_t draw) {
    Rng rng(draw);
    AntennaEcho echo(radar_returns(scene, c), {axis, array, seed}, c, rng);
    Samples samples(echo.samples());
    echo.frame(0.05, rng, samples);
    return samples;
  };
  const Scene empty = make_scene(c, SceneKind::empty, 1, 0);
  const Samples once = frame_of(empty, 7, 1);
  CHECK(once == frame_of(empty, 7, 2));
  CHECK(once != frame_of(empty, 8, 1));
  // The patches have random phases, so the power is on average that of incoherent echoes.
  const auto sum_of = [](const auto& samples) {
    return std::accumulate(samples.begin(), samples.end(), 0.0,
                           [](double sum, auto s) { return sum + std::abs(s) * std::abs(s); });
  };
  double coherent = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed)
    coherent += sum_of(frame_of(empty, seed, 1)) / 160;
  const auto incoherent = radar_power(radar_returns(empty, c), axis);
  const double expected = std::accumulate(incoherent.begin(), incoherent.end(), 0.0);
  CHECK(coherent == Approx(expected).epsilon(0.3));
  // The leakage in bin 0 has a magnitude of sqrt(3). The tolerance accounts for the side lobes of
  // the room's echo.
  check_near(once[3], std::sqrt(3), 0.3);
  // A plate that reflects nothing has no effect other than its shadow.
  Scene shadow = empty;
  shadow.plates.push_back({{0.5, 0, 3}, {1, 0, 0}, {0, 1, 0}, {{-0.2, 0, 0.2, 0, 0.4}}, 0});
  const Samples less = frame_of(shadow, 7, 3);
  double difference = 0, power = 0;
  for (std::size_t i = 0; i < once.size(); ++i) {
    difference += std::norm(once[i] - less[i]);
    if (i >= 8 * 16) power += std::norm(once[i]);
  }
  CHECK(difference > 0.001 * power);
  CHECK(difference < 0.3 * power);
}

TEST_CASE("a cached room echo plus the changes by bodies equals the fully rendered scene") {
  Conditions c = of_sum("coherent");
  c.background = "room";
  c.radar_leakage = 2;
  const AntennaRadar radar{radar_response(c), antennas_in_layout(8), 7};
  const RoomAlone room = room_alone(c, radar);
  AntennaRadar known = radar;
  known.room = room.echo;
  Conditions incoherent = c;
  incoherent.radar_sum = "incoherent";
  const RoomAlone power = room_alone(incoherent, radar);
  for (const auto kind : {SceneKind::letter, SceneKind::empty}) {
    const Scene scene = make_scene(c, kind, 5, 1);
    Returns light, echoes;
    spd_returns(scene, c, light, RoomReturns::subtracted);
    radar_returns(scene, c, echoes, RoomReturns::subtracted);
    CHECK(light.range_m.size() < 40'000);
    auto rate = spd_rate(light, c), profile = radar_power(echoes, radar.axis);
    add_room(room.light, rate);
    add_room(power.power, profile);
    const auto whole = radar_returns(scene, c);
    const auto expected = spd_rate(spd_returns(scene, c), c);
    const auto wanted_profile = radar_power(whole, radar.axis);
    for (std::size_t i = 0; i < rate.size(); ++i)
      CHECK(rate[i] == Approx(expected[i]).margin(1e-6));
    for (std::size_t i = 0; i < profile.size(); ++i)
      CHECK(profile[i] == Approx(wanted_profile[i]).margin(1e-9));
    Rng a(3), b(3);
    AntennaEcho first(whole, radar, c, a), second(echoes, known, c, b);
    Samples x(first.samples()), y(second.samples());
    first.frame(0.05, a, x);
    second.frame(0.05, b, y);
    for (std::size_t i = 0; i < x.size(); ++i) check_near(x[i], y[i], 2e-4);
  }
}

TEST_CASE("echo patches are assigned to people only if antennas are simulated") {
  Conditions c = of_sum("coherent");
  c.background = "room";
  const Returns two = radar_returns(make_scene(c, SceneKind::two_people, 3, 0), c);
  REQUIRE(two.place.size() == two.range_m.size());
  for (const std::int32_t person : {Returns::still, 0, 1})
    CHECK(std::any_of(two.place.begin(), two.place.end(),
                      [&](const Returns::PatchOrigin& p) { return p.person == person; }));
  const Returns target = radar_returns(make_scene(c, SceneKind::reflector, 3, 0), c);
  CHECK(target.place.at(0).person == Returns::reflector);
  c = of_sum("incoherent");
  c.radar_antennas = 0;
  CHECK(radar_returns(make_scene(c, SceneKind::person, 3, 0), c).place.empty());
}

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
