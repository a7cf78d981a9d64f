// SPDX-License-Identifier: MIT
// Tests the position of the calibration reflector, the position errors and the antenna phases.
#include "acquire/calibrate/reflector.hpp"

#include "../catch.hpp"
#include "acquire/calibrate/antenna_side.hpp"
#include "drivers/core/axis.hpp"

using namespace echofuse::acquire;
using Catch::Contains;

namespace {

constexpr double pi = std::numbers::pi;
constexpr double wavelength_m = speed_of_light_m_s / 60.2e9;

const std::vector<std::uint32_t> tx{0, 2};
const auto antennas = radar::heat_map_pairs(radar::Board::isk, tx, 15);

}  // namespace

TEST_CASE("the radar range of the reflector is computed from the sensor baseline") {
  Reflector r;
  CHECK(r.range_m(Sensor::spd) == 1);
  CHECK(r.range_m(Sensor::radar) == Approx(1.118034).epsilon(1e-6));
  CHECK(r.other().range_m(Sensor::radar) == 1);
  r.distance_m = 3;
  CHECK(r.range_m(Sensor::radar) == Approx(3.041381).epsilon(1e-6));
  r.mounting = Mounting::each;
  CHECK(r.range_m(Sensor::radar) == 3);
}

TEST_CASE("the reflector's range error combines the errors of its position") {
  Reflector r;
  CHECK(r.error_m(Sensor::spd) == 2e-3);
  const double along = 2e-3 / 1.118034, aside = 0.5 * 2e-3 * std::sqrt(2.0) / 1.118034;
  CHECK(r.error_m(Sensor::radar) == Approx(std::hypot(along, aside)).epsilon(1e-4));
  r.distance_error_m = 0, r.baseline_error_m = 0.01;
  CHECK(r.error_m(Sensor::radar) == Approx(0.01 * 0.5 / 1.118034).epsilon(1e-6));
  Reflector longer = r;
  longer.baseline_m += 0.01;
  CHECK(longer.range_m(Sensor::radar) - r.range_m(Sensor::radar) ==
        Approx(r.error_m(Sensor::radar)).epsilon(0.02));
  CHECK(r.other().error_m(Sensor::radar) == 0);
}

TEST_CASE("a measured range is refused if it matches the other mounting of the reflector") {
  const auto refusal = [](Mounting stated, double distance_m, double measured_m) {
    return other_mounting({.mounting = stated, .distance_m = distance_m}, measured_m, 0.2);
  };
  const auto detector = Mounting::detector, each = Mounting::each;
  for (const double measured_m : {1.118, 1.118 + 0.08, 1.118 - 0.02})
    CHECK(refusal(detector, 1, measured_m) == "");
  for (const double measured_m : {1.0, 1.08}) CHECK(refusal(each, 1, measured_m) == "");
  CHECK_THAT(refusal(detector, 1, 1.0), Contains("fits --reflector each (true range 1.000 m"));
  // A measured range of 1.05 m is only 5 cm longer than 1 m, the true range for `--reflector each`.
  CHECK_THAT(refusal(detector, 1, 1.05), Contains("the reflector is in front of the radar"));
  CHECK_THAT(refusal(each, 1, 1.168), Contains("fits --reflector detector (true range 1.118 m") &&
                                          Contains("the reflector is in front of the detector"));
  CHECK_THAT(refusal(detector, 3, 3.0), Contains("fits --reflector each"));
  CHECK_THAT(refusal(each, 3, 3.041), Contains("fits --reflector detector"));
  CHECK(refusal(detector, 3, 3.041 + 0.037) == "");
  CHECK(refusal(detector, 1, 1.5) == "");  // the range matches neither mounting
  // With a baseline of 2 cm, the ranges of the two mountings differ by only 0.2 mm.
  CHECK(other_mounting({.baseline_m = 0.02}, 1.03, 0.2) == "");
}

TEST_CASE("the wave from the reflector is plane in the far field and spherical in the near field") {
  const double sine = 0.5 / std::hypot(1, 0.5),
               per_place = 2 * pi / wavelength_m * radar::half_wavelength_m * sine;
  const auto far = steering_phases(antennas, {5000, 0, 10000}, wavelength_m);
  const auto near = steering_phases(antennas, {0.5, 0, 1}, wavelength_m);
  // Exchanging x and y of the antennas and of the reflector does not change the phases.
  auto exchanged = antennas;
  for (auto& a : exchanged) std::swap(a.tx.x, a.tx.y), std::swap(a.rx.x, a.rx.y);
  const auto upright = steering_phases(exchanged, {0, 0.5, 1}, wavelength_m);
  double bent = 0;
  for (std::size_t m = 0; m < 8; ++m) {
    CHECK(upright[m] == Approx(near[m]).margin(1e-9));
    CHECK(far[m] == Approx(static_cast<double>(m) * per_place).margin(1e-4));
    bent = std::max(bent, std::abs(near[m] - far[m]));
  }
  CHECK(bent > 0.005);
  CHECK(bent < 0.1);
  const Steering ahead = steering_of({.mounting = Mounting::each}, antennas, wavelength_m);
  CHECK(ahead.sine == 0);
  // The wave front is symmetric about the centre of the array, so the two outermost antennas have
  // equal phases.
  CHECK(std::abs(ahead.phase_rad[7]) < 0.01);
  const Steering aside = steering_of({}, antennas, wavelength_m);
  CHECK(aside.sine == Approx(sine));
  CHECK(aside.error_rad[0] == 0);
  // The position errors are 2.83 mm in x and 2 mm in z. The derivatives of the direction sine x / r
  // are z^2 / r^3 and -x z / r^3, where x = 0.5 m, z = 1 m and r^3 = 1.398 m^3.
  const double slope = std::hypot(2.83e-3 / 1.398, 2e-3 * 0.5 / 1.398);
  CHECK(aside.error_rad[7] == Approx(7 * per_place / sine * slope).epsilon(0.05));
}

TEST_CASE("an echo from a known side shows whether left and right are swapped in the antenna row") {
  const std::vector<double> channels{0, 1.1, -2, 0.4, 3, -0.7, 1.9, -1.2};
  for (const auto mounting : {Mounting::detector, Mounting::each})
    for (const bool swapped : {false, true}) {
      const Reflector reflector{.mounting = mounting};
      // Returns the phases that the board measures. A swapped antenna row mirrors these phases.
      const auto measured = [&](double x_m) {
        AntennaGains out;
        out.gain.assign(8, 1), out.standard_error.assign(8, 0);
        out.phase_rad = steering_phases(antennas, {swapped ? -x_m : x_m, 0, 1}, wavelength_m);
        for (std::size_t m = 0; m < 8; ++m) out.phase_rad[m] += channels[m];
        return out;
      };
      const double place_m = mounting == Mounting::detector ? 0.5 : 0;
      AntennaGains calibrated = measured(place_m);
      const Steering steering = steering_of(reflector, antennas, wavelength_m);
      calibrated.sine = steering.sine;
      for (std::size_t m = 0; m < 8; ++m) calibrated.phase_rad[m] -= steering.phase_rad[m];
      for (const auto& [side, x_m] :
           {std::pair{Side::right, place_m + 0.5}, {Side::left, place_m - 0.5}}) {
        const SidePlace place = place_at(side, reflector, calibrated.sine);
        CHECK(place.x_m == Approx(x_m - 0.5).margin(1e-9));
        CHECK(place.range_m == Approx(std::hypot(x_m, 1)));
        const SideFinding found =
            find_side(side, reflector, measured(x_m), calibrated, antennas, wavelength_m);
        CAPTURE(swapped, found.sine, found.expected, found.if_swapped);
        CHECK(found.refusal.empty());
        CHECK(found.swapped == swapped);
        CHECK_THAT(to_text(side, found), Contains(swapped ? "is reversed" : "is correct"));
      }
      if (!swapped)
        CHECK_THAT(find_side(Side::right, reflector, measured(place_m - 1.2), calibrated, antennas,
                             wavelength_m)
                       .refusal,
                   Contains("check the reflector's position"));
    }
}
