// SPDX-License-Identifier: MIT
// Tests loading and prediction with the two default runs, in which a swapped axis, a wrong sign and
// a mixed-up file or zone change the result.
#include "recon/predict/trained_model.hpp"
#include "world.hpp"

namespace {

using Kind = RunBuilder (*)(std::int64_t);

// Extent of a body in a depth map, in tangents, and its depth.
struct Seen {
  double left = 1, right = -1, low = 1, high = -1, z = 0;
  double x() const { return (left + right) / 2 * z; }
};

Seen seen_in(std::span<const float> map, const record::MapGrid& grid) {
  Seen out;
  for (std::size_t row = 0; row < grid.size; ++row)
    for (std::size_t c = 0; c < grid.size; ++c) {
      const double z = double{map[row * grid.size + c]};
      if (z == 0) continue;
      const double right = grid.x().at(static_cast<double>(c));
      const double up = grid.y().at(static_cast<double>(row));
      out.left = std::min(out.left, right), out.right = std::max(out.right, right);
      out.low = std::min(out.low, up), out.high = std::max(out.high, up), out.z = z;
    }
  return out;
}

// Mean position of the values above `background`, on the axis.
double centroid(std::span<const float> values, const Axis& axis, float background, double shift) {
  double sum = 0, moment = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double above = std::max(0.0f, values[i] - background);
    sum += above, moment += above * axis.at(static_cast<double>(i) + shift);
  }
  return moment / sum;
}

// Scores the body positions that a model finds in records of other plates.
double lateral_error_m(const std::string& kind, const std::string& inputs) {
  const TrainedModel trained = load_model(made_default_model(kind, inputs));
  return scores_of(trained, load({made_default_run(kind, "40", "2")}))[metric_lateral_m].mean;
}

}  // namespace

TEST_CASE("the sensors of two loaded files show each body at the same place") {
  const Kind kind = GENERATE(Kind{one_pixel}, Kind{nine_zones});
  const Folder dir;
  const Dataset data = load({kind(5).seed(1).write(dir / "a"), kind(3).seed(2).write(dir / "b")});
  REQUIRE(data.size() == 8);
  CHECK(values_of(data, &RecordInfo::index) == std::vector<std::int64_t>{0, 1, 2, 3, 4, 0, 1, 2});
  const Zones& zones = photons(data).axis.zones;
  CHECK(zones == kind(1).zones());
  const double pixel = data.map.step();
  std::vector<double> places;
  for (std::size_t row = 0; row < data.size(); ++row) {
    CAPTURE(row);
    const Seen body = seen_in(depth_maps(data).row(row), data.map);
    const double spd_m = std::hypot(body.x(), body.z), radar_m = std::hypot(body.x() + 0.5, body.z);
    places.push_back(body.x());
    CHECK(body.low == Approx(-0.3).margin(2 * pixel));
    CHECK(body.high == Approx(0.15).margin(2 * pixel));
    const auto level = static_cast<float>(3 * zones.size());
    CHECK(centroid(counts_of(data, row), photons(data).axis, level, 0.5) / ps_per_m ==
          Approx(spd_m).margin(0.06));
    CHECK(centroid(profiles(data).row(row), profiles(data).axis, 0.02f, 0) ==
          Approx(radar_m).margin(0.06));
    if (zones.size() == 1) continue;
    std::vector<double> light;
    for (std::size_t zone = 0; zone < zones.size(); ++zone) {
      CAPTURE(zone);
      const auto counts_of_zone =
          photons(data).row(row).subspan(zone * photons(data).axis.count, photons(data).axis.count);
      light.push_back(std::accumulate(counts_of_zone.begin(), counts_of_zone.end(), 0.0));
      if (light.back() > 2000)
        CHECK(centroid(counts_of_zone, photons(data).axis, 8, 0.5) / ps_per_m ==
              Approx(spd_m).margin(0.06));
    }
    // The zones of the middle row see the centre of the body. Their order is left, centre, right.
    const double right = body.x() / body.z;
    if (std::abs(right) > 0.2) CHECK((light[5] > light[3]) == (right > 0));
    CHECK(light[3] + light[4] + light[5] > light[0] + light[1] + light[2]);
  }
  // Different plates in both files.
  for (std::size_t row = 5; row < 8; ++row) CHECK(places[row] != places[row - 5]);
}

TEST_CASE("models find the bodies of the default runs, and nine zones suffice without a radar") {
  CHECK(lateral_error_m("one_pixel", "fused") < 0.12);
  CHECK(lateral_error_m("nine_zones", "fused") < 0.12);
  CHECK(lateral_error_m("nine_zones", "spd") < 0.12);
}
