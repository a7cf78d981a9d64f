// SPDX-License-Identifier: MIT
// Tests how models learn the lateral position: profile sampling, correlation and rotated bodies.
#include "recon/method/rotation.hpp"

#include "recon/method/method.hpp"
#include "world.hpp"

namespace {

constexpr double baseline_m = 0.5;

double radar_range_m(const Place& place, double range_m) {
  const double sine = std::sin(std::atan(double{place.tangent}));
  return std::sqrt(range_m * range_m + baseline_m * baseline_m + 2 * baseline_m * range_m * sine);
}

// Records of an object at a range of 3.5 m. The angle of the object varies across the field of
// view.
struct Bodies {
  Alignment alignment = blank_alignment();
  Matrix inputs, radar, array;
  std::vector<Place> places;
  Rows rows;
  static constexpr double range_m = 3.5;
  Bodies() {
    Matrix raw(0, spd_axis().count + radar_axis().count);
    radar = Matrix(0, radar_axis().count);
    for (int i = -20; i <= 20; ++i) {
      const auto tangent = static_cast<float>(i) * 0.015f;
      const auto depth_m = static_cast<float>(range_m / std::hypot(1.0, double{tangent}));
      places.push_back({tangent, depth_m});
      raw.add_row(of(places.back()));
      radar.add_row(std::span<const float>(raw.row(raw.rows - 1)).last(radar.cols));
    }
    inputs = align(raw, alignment);
    rows = all_rows(raw.rows);
  }
  static std::vector<float> of(const Place& place) {
    return one_object(range_m, radar_range_m(place, range_m));
  }
};

}  // namespace

TEST_CASE("the bin width of an aligned radar profile is that of the radar, but at least 2 cm") {
  const auto check = [](const Axis& radar, double width_m, double step_m) {
    const Alignment alignment = blank_alignment(radar);
    CHECK(alignment.profile_points() == 1 + static_cast<std::size_t>(1.9 / step_m));
    std::vector<float> features(alignment.size());
    align(one_object(3.5, 3.61, radar, width_m), alignment, features);
    REQUIRE(shows_body(features));
    const auto columns = alignment.columns(std::span<const float>(features));
    CHECK(columns.correlation.empty());
    const std::span<const float> profile = columns.profile;
    double sum = 0;
    const auto at = [&](std::size_t j) {
      return bump(double{columns.range_m} - 0.8 + static_cast<double>(j) * step_m - 3.61, width_m);
    };
    for (std::size_t j = 0; j < profile.size(); ++j) sum += at(j);
    for (std::size_t j = 0; j < profile.size(); ++j)
      REQUIRE(double{profile[j]} == Approx(at(j) / sum).margin(0.005 / sum));
  };
  check(radar_axis(), 0.4, 0.125);
  check({"radar", "power", "m", 319, 0, 0.022, 1}, 0.04, 0.022);
  check({"radar", "power", "m", 1400, 0, 0.005, 1}, 0.04, 0.02);
}

TEST_CASE("the correlation of a radar profile with the blurred histogram peaks at the true shift") {
  const ShiftCorrelation correlation({-0.68, 0.04, 35}, {-1, 0.02, 116}, 0.05, -0.3, 0.6);
  std::vector<float> histogram, profile, found(correlation.shifts());
  for (int i = 0; i < 35; ++i)
    histogram.push_back(static_cast<float>(bump(i * 0.04 - 0.68 - 0.1, 0.2)));
  for (int j = 0; j < 116; ++j)
    profile.push_back(static_cast<float>(bump(j * 0.02 - 1 - 0.1 - 0.16, 0.2)));
  correlation(histogram, profile, found);
  const auto best = std::max_element(found.begin(), found.end());
  CHECK(double{*best} > 0.99);
  CHECK(0.6 - 0.02 * static_cast<double>(best - found.begin()) == Approx(0.16).margin(0.011));
  std::fill(profile.begin(), profile.end(), 0.f);
  correlation(histogram, profile, found);
  CHECK(std::all_of(found.begin(), found.end(), [](float v) { return v == 0; }));
}

TEST_CASE("the sensor baseline is estimated from records with different body positions") {
  const Bodies bodies;
  const auto found = [&](const std::vector<Place>& places) {
    return RotatedBodies(bodies.alignment, bodies.inputs, bodies.radar, bodies.array, bodies.rows,
                         places)
        .baseline_m();
  };
  CHECK(found(bodies.places) == Approx(baseline_m).margin(0.01));
  std::vector<Place> others = bodies.places;
  for (Place& place : others) place.tangent = -place.tangent;
  CHECK(found(others) == Approx(-baseline_m).margin(0.01));
  Rng rng = make_rng(1, 0);
  std::shuffle(others.begin(), others.end(), rng);
  CHECK(found(others) == 0);
  std::fill(others.begin(), others.end(), Place{0.1f, 3.5f});
  CHECK(found(others) == 0);
}

TEST_CASE("model inputs of a rotated body equal those of a body at the rotated position") {
  const Bodies bodies;
  const RotatedBodies rotated(bodies.alignment, bodies.inputs, bodies.radar, bodies.array,
                              bodies.rows, bodies.places);
  Rng rng = make_rng(2, 0);
  std::vector<float> inputs(bodies.alignment.inputs());
  for (int i = 0; i < 100; ++i) {
    const Place place =
        rotated.rotate(static_cast<std::size_t>(i) % bodies.rows.size(), rng, inputs);
    CHECK(double{place.depth_m} * std::hypot(1.0, double{place.tangent}) ==
          Approx(Bodies::range_m).margin(1e-3));
    Matrix raw(0, spd_axis().count + radar_axis().count);
    raw.add_row(Bodies::of(place));
    const Matrix expected = align(raw, bodies.alignment);
    for (std::size_t c = 0; c < inputs.size(); ++c)
      REQUIRE(inputs[c] == Approx(expected.values[c]).margin(5e-3));
  }
}
