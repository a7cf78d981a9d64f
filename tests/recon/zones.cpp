// SPDX-License-Identifier: MIT
#include "recon/data/features.hpp"
#include "recon/method/method.hpp"
#include "recon/metrics/mirrored_camera.hpp"
#include "recon/train/fit_uncertainty.hpp"
#include "world.hpp"

using Catch::Contains;

namespace {

constexpr std::uint32_t bins = 40;
const Axis spd{"spd", "counts", "ps", bins, 0, 100, 1};

// Writes a run with a single record. Zone z has 100 counts in bin `first` + z and none elsewhere.
void write_zones(const std::string& path, const Zones& zones, std::uint32_t first,
                 double offset_m = 0) {
  RunBuilder run = a_run(1);
  if (offset_m != 0) run.offset(Sensor::spd, offset_m);
  run.only_axes({spd}).zones(zones).each([&](FusedRecord& r) {
    lose(r, Sensor::radar), lose(r, Sensor::depth);
    counts(r).assign(zones.size() * bins, 0);
    for (std::uint32_t z = 0; z < zones.size(); ++z) counts(r)[z * bins + first + z] = 100;
  });
  run.write(path);
}

const Zones two{{-0.1, 0, 0.2, 200}, {0.1, 0, 0.2, 300}};

}  // namespace

TEST_CASE(
    "zone histograms are loaded with corrected ranges, and the pixel histogram is their sum") {
  const Folder folder;
  write_zones(folder / "a", two, 12, 500 / ps_per_m);
  const Dataset data = load({folder / "a"});
  CHECK(photons(data).axis.zones == two);
  REQUIRE(photons(data).cols == 2 * bins);
  CHECK(photons(data).row(0)[5] == Approx(100));
  CHECK(photons(data).row(0)[bins + 5] == Approx(100));
  REQUIRE(counts_of(data, 0).size() == bins);
  CHECK(counts_of(data, 0)[5] == Approx(200));
  CHECK(photons(part_of(data, {0})).values == photons(data).values);
}

TEST_CASE("a data set recorded with a single-pixel detector has one zone") {
  const Folder folder;
  write_zones(folder / "a", single_pixel(), 12);
  const Dataset data = load({folder / "a"});
  CHECK(photons(data).axis.zones == Zones(1));
  CHECK(photons(data).row(0)[12] == 100);
  CHECK(counts_of(data, 0)[12] == 100);
}

TEST_CASE("each zone histogram is interpolated to the time axis of the model") {
  const Folder folder;
  write_zones(folder / "a", Zones(2), 10);
  Dataset data = load({folder / "a"});
  ColumnAxis expected = photons(data).axis;
  expected.start = 50;
  match_axes(data, {expected, profiles(data).axis}, Inputs::spd);
  CHECK(photons(data).row(0)[10] == Approx(50));
  CHECK(photons(data).row(0)[bins + 10] == Approx(50));
  CHECK(photons(data).row(0)[bins + 11] == Approx(50));
}

TEST_CASE("a model of a single pixel receives the sum over the zones") {
  const Folder folder;
  write_zones(folder / "a", two, 12, 500 / ps_per_m);
  Dataset data = load({folder / "a"});
  const std::vector<float> sum = counts_of(data, 0);
  match_axes(data, {spd}, Inputs::spd);
  CHECK(photons(data).axis.zones.size() == 1);
  CHECK(photons(data).values == sum);
}

TEST_CASE("loading refuses two runs with different detector zones") {
  const Folder folder;
  write_zones(folder / "a", two, 12);
  write_zones(folder / "b", Zones(3), 12);
  write_zones(folder / "c", {{-0.1, 0, 0.2, 0}, {0.1, 0.05, 0.2, 0}}, 12);
  write_zones(folder / "d", {{-0.1, 0, 0.2, 0}, {0.1, 0.005, 0.2, 0}}, 12);
  CHECK_THROWS_WITH(load({folder / "a", folder / "b"}), Contains("3 zones, expected 2"));
  CHECK_THROWS_WITH(load({folder / "a", folder / "c"}),
                    Contains("zone 1 is at x 0.10, y 0.05 (tangents), expected x 0.10, y 0.00"));
  CHECK(load({folder / "a", folder / "d"}).size() == 2);
}

TEST_CASE("raw model inputs are all zone histograms, and observations also contain their sum") {
  const Folder folder;
  write_zones(folder / "a", two, 12);
  write_zones(folder / "b", Zones(3), 12);
  const Dataset data = load({folder / "a"});
  const Features all = fit_features(data, {}, Inputs::spd, "plain"),
                 raw = fit_features(data, {}, Inputs::spd, raw_scaling);
  CHECK(all.raw_inputs(data, {0}).values == photons(data).values);
  std::vector<float> both = counts_of(data, 0);
  both.insert(both.end(), photons(data).values.begin(), photons(data).values.end());
  for (const Features& any : {all, raw}) CHECK(observe(data, {0}, any).values == both);
  Dataset other = load({folder / "b"});
  CHECK_THROWS_WITH(match_axes(other, all.axes, Inputs::spd), Contains("3 zones, expected 2"));
}

namespace {

// Returns records of plates in front of two zones. If `by_side` is true, the lateral position of
// the plate determines how the light is shared between the zones. Otherwise, each zone receives
// half of the light.
Dataset plates_in_zones(std::size_t records, bool by_side) {
  Dataset data = load_plates(records);
  const Rows rows = all_rows(data.size());
  const SceneModel scene = learn_scene(depth_maps(data), rows, data.map);
  const Matrix pixel = photons(data);
  photons(data) = Matrix(rows.size(), 2 * pixel.cols), photons(data).axis.zones = Zones(2);
  for (const std::size_t row : rows) {
    const float tangent =
        by_side ? place_of(depth_maps(data).row(row), scene.background, scene.grid)->tangent : 0;
    for (std::size_t c = 0; c < pixel.cols; ++c) {
      photons(data).row(row)[c] = (0.5f - tangent) * pixel.row(row)[c];
      photons(data).row(row)[pixel.cols + c] = (0.5f + tangent) * pixel.row(row)[c];
    }
  }
  return data;
}

// Returns the mean lateral error in m of a factorised model that uses only the detector zones.
double lateral_error_m(bool by_side) {
  const Dataset data = plates_in_zones(400, by_side);
  TrainOptions options = quiet_options("factorised-4", 30);
  options.inputs = "spd";
  return scores_of(train(data, options), data)[metric_lateral_m].mean;
}

}  // namespace

TEST_CASE("the factorised model finds the lateral body position from detector zones alone") {
  CHECK(lateral_error_m(true) < 0.1);
  CHECK(lateral_error_m(false) > 0.3);
}

TEST_CASE("depth maps that are mirrored or upside down contradict the zones") {
  Dataset data = plates_in_zones(60, true);
  const auto found = [&](double x, double y) {
    photons(data).axis.zones = {{-x, -y, 0.5, 0}, {x, y, 0.5, 0}};
    return mirrored_camera(data);
  };
  CHECK(found(0.3, 0).empty());
  CHECK_THAT(found(-0.3, 0), Contains("wrong side (correlation with the side of the light in the"));
  for (std::size_t row = 0; row < data.size(); ++row) {  // left becomes up
    const auto map = depth_maps(data).row(row);
    for (std::size_t p = 0; p < map.size(); ++p)
      if (p / 64 < p % 64) std::swap(map[p], map[64 * (p % 64) + p / 64]);
  }
  CHECK(found(0, -0.3).empty());
  CHECK_THAT(found(0, 0.3), Contains(": the depth maps are upside down"));
}

TEST_CASE("the fallback model for missing radar data is factorised if the run has zones") {
  TrainOptions options = quiet_options("ridge", 2);
  options.fallback = true;
  const TrainedModel model = train(plates_in_zones(60, true), options);
  REQUIRE(model.estimators.size() == 2);
  CHECK(model.estimators[1].name == "factorised");
}

TEST_CASE("a model of zones refuses zones in another order, mirrored or without directions") {
  const Folder dir;
  nine_zones(24).write(dir / "a");
  TrainOptions options = quiet_options("ridge");
  options.inputs = "spd";
  const TrainedModel model = train(load({dir / "a"}), options);
  const auto prepared = [&](auto change) {
    Dataset data = load({dir / "a"});
    change(photons(data).axis.zones);
    return prepare_records(model, std::move(data)).data.size();
  };
  CHECK(prepared([](Zones&) {}) == 24);
  CHECK(prepared([](Zones& zones) { zones[4].x += 0.009; }) == 24);
  CHECK_THROWS_WITH(prepared([](Zones& zones) { std::swap(zones[3], zones[5]); }),
                    Contains("zone 3 is at x 0.33, y -0.02 (tangents), expected x -0.29, y "
                             "-0.03; are the zones in another order?"));
  CHECK_THROWS_WITH(prepared([](Zones& zones) {
                      for (Zone& zone : zones) zone.y = -zone.y;
                    }),
                    Contains(": zone 0 is at"));
  CHECK_THROWS_WITH(prepared([](Zones& zones) { zones[4].width = 0.5; }),
                    Contains("zone 4 has width 0.50 (tangents), expected "));
  CHECK_THROWS_WITH(prepared([](Zones& zones) { zones = Zones(zones.size()); }),
                    Contains("the directions of the zones are unknown, expected known"));
}

TEST_CASE("degrading a record thins each of its zones") {
  Dataset data = plates_in_zones(40, true);
  const Dataset before = data;
  Rng rng = make_rng(3, 0);
  degrade(data, rng);
  double kept = 0, all = 0;
  for (std::size_t i = 0; i < data.size(); ++i)
    for (std::size_t c = 0; c < photons(data).cols; ++c) {
      REQUIRE(photons(data).row(i)[c] <= std::round(photons(before).row(i)[c]));
      kept += double{photons(data).row(i)[c]}, all += double{photons(before).row(i)[c]};
    }
  CHECK(kept < 0.6 * all);
}
