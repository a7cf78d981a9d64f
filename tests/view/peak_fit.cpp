// SPDX-License-Identifier: MIT
#include "recon/live/peak_fit.hpp"

#include <nlohmann/json.hpp>

#include "../catch.hpp"
#include "../fixtures/record.hpp"
#include "recon/live/tally.hpp"

using namespace echofuse::view;
using namespace echofuse::test;

namespace {

constexpr std::size_t bins = 300;
const Axis axis{
    .name = "x", .quantity = "counts", .unit = "m", .count = bins, .start = 2, .step = 0.015};

struct Bump {
  double centre_m, sigma_m, clicks;
};

// Returns the counts of Gaussian peaks on a constant background. The counts are Poisson
// distributed, or equal to their means if `seed` is 0.
std::vector<double> counts_of(const std::vector<Bump>& bumps, double background, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<double> out;
  for (std::size_t i = 0; i < bins; ++i) {
    double mean = background;
    for (const Bump& b : bumps) {
      const double u = (axis.start + axis.step * static_cast<double>(i) - b.centre_m) / b.sigma_m;
      mean += b.clicks * axis.step / b.sigma_m / std::sqrt(2 * M_PI) * std::exp(-u * u / 2);
    }
    out.push_back(seed == 0 ? mean : std::poisson_distribution<int>(mean)(random));
  }
  return out;
}

constexpr double whole = 1e6;

}  // namespace

TEST_CASE("the peak fit recovers the centre and the width within the error that it reports") {
  int outside = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    const auto fit =
        fit_peak(counts_of({{3.217, 0.06, 5000}}, 20, seed), axis, -whole, whole, true);
    REQUIRE(fit);
    CHECK(fit->centre_error == Approx(0.06 / std::sqrt(5000)).epsilon(0.4));
    CHECK(fit->fwhm == Approx(2.3548 * 0.06).epsilon(0.1));
    outside += std::abs(fit->centre - 3.217) > 2 * fit->centre_error;
  }
  // About 5 % of the 50 fits are expected to have an error of more than two standard errors. More
  // than 8 such fits occur by chance in only one of 1000 tests.
  CHECK(outside <= 8);
}

TEST_CASE("the peak fit uses only the given range and finds no peak in pure background") {
  const auto two = counts_of({{3, 0.05, 9000}, {5, 0.1, 4000}}, 10, 1);
  CHECK(fit_peak(two, axis, -whole, whole, true)->centre == Approx(3).margin(0.01));
  CHECK(fit_peak(two, axis, 4.2, 6, true)->centre == Approx(5).margin(0.02));
  for (unsigned seed = 1; seed <= 20; ++seed)
    CHECK_FALSE(fit_peak(counts_of({}, 30, seed), axis, -whole, whole, true));
  CHECK_FALSE(fit_peak(std::vector<double>(bins, 0.0), axis, -whole, whole, true));
  CHECK_FALSE(fit_peak({}, axis, -whole, whole, true));
}

TEST_CASE("the peak fit recovers the centre and the width of an echo in radar power") {
  std::vector<double> power = counts_of({{4, 0.08, 1}}, 1e-3, 0);
  const auto fit = fit_peak(power, axis, -whole, whole, false);
  REQUIRE(fit);
  CHECK(fit->centre == Approx(4).margin(1e-4));
  CHECK(fit->fwhm == Approx(2.3548 * 0.08).epsilon(1e-3));
}

TEST_CASE("the dark count rate is estimated from the clicks before the first return") {
  record::FusedRecord r;
  r.valid = {Sensor::spd};
  r.slot_end = std::chrono::seconds(2);
  const std::vector<Axis> axes{
      {.name = "spd", .quantity = "counts", .unit = "ps", .count = bins, .start = 0, .step = 100}};
  const auto clicks = counts_of({{4, 0.06, 20'000}}, 25, 3);
  counts(r).assign(clicks.begin(), clicks.end());
  const double all = std::accumulate(clicks.begin(), clicks.end(), 0.0);
  r.spd_counts = {.starts = 1'000'000, .in_range = static_cast<std::uint64_t>(all)};
  Tally tally;
  tally.add(r, axes);
  const auto rates = tally.numbers(axes)["rates"];
  CHECK((rates["sync_hz"] == 500'000 && rates["pulse_hz"] == 500'000));
  // If a filter removes sync tags, the laser rate passed by the caller is used as the pulse rate.
  CHECK(tally.numbers(axes, 2e7)["rates"]["pulse_hz"] == 2e7);
  CHECK(rates["click_hz"] == Approx(all / 2));
  CHECK(rates["clicks_per_pulse"] == Approx(all / 1e6));
  CHECK(rates["dark_hz"].get<double>() == Approx(25 / (1e6 * 100e-12)).epsilon(0.1));
  // If a filter passes only the sync tags of clicks, and the laser rate is unknown, so is the
  // number of clicks per pulse. It would otherwise seem to be 1 (pile-up).
  record::FusedRecord weak = r;
  weak.spd_counts.starts = weak.spd_counts.in_range;
  Tally dim;
  dim.add(weak, axes);
  for (const char* unknown : {"pulse_hz", "dark_hz", "clicks_per_pulse"})
    CHECK(dim.numbers(axes)["rates"][unknown].is_null());
  dim.add(r, axes), dim.add(weak, axes, -1);
  CHECK(dim.numbers(axes)["rates"]["clicks_per_pulse"] == rates["clicks_per_pulse"]);
  // After a record is removed from the tally, the sum of the other records must remain.
  record::FusedRecord other = r;
  counts(other).assign(bins, 7);
  tally.add(other, axes), tally.add(r, axes, -1);
  CHECK(tally.clicks() == std::vector<double>(bins, 7));
}
