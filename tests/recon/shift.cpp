// SPDX-License-Identifier: MIT
#include "recon/data/shift.hpp"

#include "../catch.hpp"

using echofuse::recon::Shift;

namespace {

constexpr double pi = std::numbers::pi;

// Returns the power of a point echo after a matched filter. The sampling interval is half the range
// resolution, so a narrower echo could not be represented by the samples.
std::vector<float> echo(double place) {
  std::vector<float> out;
  for (int i = 0; i < 40; ++i) {
    const double u = (i - place) / 2;
    out.push_back(static_cast<float>(std::pow(u == 0 ? 1 : std::sin(pi * u) / (pi * u), 2)));
  }
  return out;
}

}  // namespace

TEST_CASE("a narrow radar echo keeps its shape when shifted by a fraction of a bin") {
  for (const double steps : {0.2, 0.5, -0.7, 3.3, -5.0}) {
    CAPTURE(steps);
    const auto moved = Shift(steps).apply(echo(20.4)), expected = echo(20.4 - steps);
    // The tolerance is 2.5 % of the peak. For comparison, linear interpolation halfway between
    // samples has an error of 19 %.
    for (std::size_t i = 10; i < 30; ++i) CHECK(moved[i] == Approx(expected[i]).margin(0.025));
    CHECK(std::accumulate(moved.begin(), moved.end(), 0.) ==
          Approx(std::accumulate(expected.begin(), expected.end(), 0.)).epsilon(1e-2));
  }
}

TEST_CASE("a shift by whole bins copies values and pads with zeros") {
  const std::vector<float> values = {1, 2, 3, 4, 5};
  CHECK(Shift(2.3).apply({7, 7, 7, 7, 7}) ==
        // If all values are equal, as for a dead sensor, they must remain equal.
        std::vector<float>(5, 7));
  CHECK(Shift().apply(values) == values);
  CHECK(Shift(2).apply(values) == std::vector<float>{3, 4, 5, 0, 0});
  CHECK(Shift(-1).apply(values) == std::vector<float>{0, 1, 2, 3, 4});
  CHECK(Shift(100).apply(values) == std::vector<float>(5));
}
