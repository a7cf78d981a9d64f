// SPDX-License-Identifier: MIT
#include "recon/trust/static_echoes.hpp"

#include "recon/trust/domain_shift.hpp"
#include "world.hpp"

namespace {

struct Room {
  double wall_m = 5.3, radar_error_m = 0, spd_error_m = 0, light = 1, cupboard = 0;
  double late_error_m = 0;  // additional range error of the radar in the last fifth of the records
};

// A room with a wall, a floor echo and a body that moves. Both sensors see them.
Dataset records_of(const Room& room, std::size_t count, std::uint64_t seed) {
  Dataset data;
  data.spd().axis = Axis{"spd", "counts", "ps", 336, 13343, 100, 1};
  data.radar().axis = Axis{"radar", "power", "m", 29, 0, 0.25, 1};
  Rng rng = make_rng(seed, 5);
  std::uniform_real_distribution<double> body(3, 4);
  std::normal_distribution<double> noise;
  const auto bump = [](double x, double at, double width) {
    return std::exp(-0.5 * std::pow((x - at) / width, 2));
  };
  // Power of an echo without a window, for range cells of 50 cm.
  const auto echo = [](double x, double at) {
    const double u = std::numbers::pi * (x - at) / 0.5;
    return u == 0 ? 1 : std::pow(std::sin(u) / u, 2);
  };
  // Power of the body and the walls. `far` is the power of the second wall echo.
  const auto scene = [&](const auto& shape, double at, double far_m, double far) {
    if (room.wall_m == 0) return shape(at, 1);
    return shape(at, 1) + 4 * shape(room.wall_m, 1) + far * shape(room.wall_m + far_m, 1.3) +
           room.cupboard * shape(room.wall_m - 0.3, 1);
  };
  for (std::size_t i = 0; i < count; ++i) {
    const double at = body(rng);
    std::vector<float> counts, power;
    for (std::size_t k = 0; k < 336; ++k) {
      const double r = (13343 + 100 * (static_cast<double>(k) + 0.5)) / ps_per_m;
      const auto seen = [&](double at_m, double wider) {
        return bump(r - room.spd_error_m, at_m, 0.1 * wider);
      };
      std::poisson_distribution<int> clicks(room.light * (5 + 60 * scene(seen, at, 0.7, 1.5)));
      counts.push_back(static_cast<float>(clicks(rng)));
    }
    for (std::size_t k = 0; k < 29; ++k) {
      const double error_m = room.radar_error_m + (5 * i < 4 * count ? 0 : room.late_error_m);
      const double r = 0.25 * static_cast<double>(k) - error_m;
      const auto seen = [&](double at_m, double) { return echo(r, at_m); };
      power.push_back(static_cast<float>(scene(seen, at, 0.8, 3) * (1 + 0.02 * noise(rng))));
    }
    data.spd().cols = 336, data.radar().cols = 29;
    data.spd().add_row(counts), data.radar().add_row(power);
    data.records.push_back({.valid = {echofuse::Sensor::spd, echofuse::Sensor::radar}});
  }
  return data;
}

std::optional<RangeDifference> difference(const Room& room, std::size_t count = 100,
                                          std::uint64_t seed = 2) {
  static const StaticEchoes known(records_of({}, 400, 1), all_rows(400));
  return known.compare(records_of(room, count, seed), all_rows(count));
}

}  // namespace

TEST_CASE("static echoes show a range error of one sensor but no other change") {
  for (const double error_m : {-0.05, -0.02, 0.02, 0.05}) {
    CAPTURE(error_m);
    const auto radar = difference({.radar_error_m = error_m}),
               spd = difference({.spd_error_m = error_m});
    REQUIRE((radar && spd));
    CHECK((radar->found() && spd->found()));
    CHECK(radar->difference_m == Approx(error_m).margin(0.004));
    CHECK(spd->difference_m == Approx(-error_m).margin(0.004));
    CHECK(radar->standard_error_m < 0.003);
    CHECK_THAT(radar->text(), Contains(error_m > 0 ? "cm too long" : "cm too short"));
  }
  // The same room, brighter light, and sensors that were moved together.
  for (std::uint64_t seed = 10; seed < 20; ++seed)
    for (const Room& room : {Room{}, {.light = 2}, {.radar_error_m = 0.03, .spd_error_m = 0.03}}) {
      CAPTURE(seed, room.light, room.radar_error_m);
      CHECK_FALSE(difference(room, 100, seed)->found());
    }
}

TEST_CASE("a range difference that changes during the run has a large standard error") {
  const auto steady = difference({}), changed = difference({.late_error_m = 0.05});
  REQUIRE((steady && changed));
  CHECK(changed->standard_error_m == Approx(0.05 / 5).margin(0.002));
  CHECK(changed->standard_error_m > 5 * steady->standard_error_m);
}

TEST_CASE("a range error is not stated without the static echoes of the training") {
  CHECK_FALSE(difference({.wall_m = 0}));
  CHECK_FALSE(difference({.cupboard = 1}));
  CHECK_FALSE(difference({.wall_m = 5.8}));
  CHECK_FALSE(difference({}, StaticEchoes::min_records - 1));
  const StaticEchoes none(records_of({.wall_m = 0}, 400, 1), all_rows(400));
  CHECK_FALSE(
      none.compare(records_of({.wall_m = 0, .radar_error_m = 0.02}, 100, 2), all_rows(100)));
  const StaticEchoes few(records_of({}, 49, 1), all_rows(49));
  CHECK_FALSE(few.known());
}

TEST_CASE("the message of a run names a range difference and whether most records are unusual") {
  DomainShift shift{.records = 100};
  shift.range_difference = RangeDifference{0.021, 0.002}.text();
  CHECK(shift.found());
  CHECK_THAT(shift.text(), Contains("radar ranges are 2.1 +- 0.2 cm too long") &&
                               Contains("--range-offset 0.021"));
  shift = {.records = 100, .p = 1e-4, .differences = {{"range +2.0 +- 0.1 cm", 20, "use X"}}};
  CHECK_THAT(shift.text(), EndsWith("p < 0.001: range +2.0 +- 0.1 cm; use X"));
  shift.assessed = 100, shift.flagged = 60, shift.reason = "unusual range";
  CHECK_THAT(shift.text(),
             EndsWith("60 of 100 records are unusual (most: unusual range); p < 0.001: range +2.0 "
                      "+- 0.1 cm; use X"));
}

TEST_CASE("the advice of a run is that of the largest differences, or of the most frequent flag") {
  DomainShift shift{.records = 100,
                    .p = 1e-4,
                    .differences = {{"range +2.0 cm", 20}, {"radar range +1.0 cm", 6, "use X"}},
                    .assessed = 100,
                    .flagged = 60};
  for (const RecordNumber& number : record_numbers) {
    shift.reason = number.name;
    CAPTURE(shift.reason);
    const std::string advice = number.advice;
    CHECK_THAT(shift.text(), EndsWith("range +1.0 cm" + (advice.empty() ? "" : "; " + advice)));
  }
  shift.differences[1].standard_errors = 7;
  CHECK_THAT(shift.text(), EndsWith("radar range +1.0 cm; use X"));
  shift.flagged = 50, shift.differences[1].standard_errors = 6;
  CHECK_THAT(shift.text(), EndsWith("p < 0.001: range +2.0 cm, radar range +1.0 cm"));
}
