// SPDX-License-Identifier: MIT
#include "acquire/measurement/detector.hpp"
#include "recon/data/features.hpp"
#include "recon/method/method.hpp"
#include "recon/metrics/mirrored_camera.hpp"
#include "recon/train/fit_uncertainty.hpp"
#include "world.hpp"

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

TEST_CASE("zone histograms have corrected ranges, and the pixel histogram is their sum") {
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

TEST_CASE("loading corrects pile-up in each zone, unless the detector was hardly ever ready") {
  const Folder folder;
  const auto loaded = [&](std::uint32_t clicks) {
    std::filesystem::remove(folder / "a");
    const auto [key, value] = record::Detector{std::numeric_limits<double>::infinity()}.meta();
    record::RunInfo info;
    info.window_s = 3;
    RunBuilder run = a_run(1).only_axes({spd}).zones(Zones(2)).each([=](FusedRecord& r) {
      lose(r, Sensor::radar), lose(r, Sensor::depth);
      counts(r).assign(2 * bins, 0);
      counts(r)[5] = clicks, counts(r)[bins + 5] = 100;
      r.spd_counts.in_range = 600, r.signal.clicks_per_pulse = 0.6;  // 1000 laser pulses
    });
    return load({run.info(info).meta(key, value).write(folder / "a")});
  };
  const Dataset some = loaded(500), most = loaded(990);
  CHECK(photons(some).row(0)[5] == Approx(-1000 * std::log(1 - 0.5)));
  CHECK(photons(some).row(0)[bins + 5] == Approx(-1000 * std::log(1 - 0.1)));
  CHECK(some.records[0].clicks_per_pulse == 0);
  CHECK(most.records[0].clicks_per_pulse == 0.6);
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
  const std::vector<std::pair<Zones, std::string>> others{
      {Zones(3), "3 zones, expected 2"},
      {{{-0.1, 0, 0.2, 0}, {0.1, 0.05, 0.2, 0}},
       "zone 1 is at x 0.10, y 0.05 (tangents), expected x 0.10, y 0.00"},
      {{{-0.1, 0, 0.2, 0}, {0.1, 0.005, 0.2, 0}}, "no error"}};
  for (const auto& [zones, text] : others) {
    std::filesystem::remove(folder / "b");
    write_zones(folder / "b", zones, 12);
    CHECK_THAT(error_of([&] { load({folder / "a", folder / "b"}); }), Contains(text));
  }
}

TEST_CASE("raw model inputs are all zone histograms, and observations also contain their sum") {
  const Folder folder;
  write_zones(folder / "a", two, 12);
  const Dataset data = load({folder / "a"});
  const Features all = fit_features(data, {}, Inputs::spd, "plain"),
                 raw = fit_features(data, {}, Inputs::spd, raw_scaling);
  CHECK(all.raw_inputs(data, {0}).values == photons(data).values);
  std::vector<float> both = counts_of(data, 0);
  both.insert(both.end(), photons(data).values.begin(), photons(data).values.end());
  for (const Features& any : {all, raw}) CHECK(observe(data, {0}, any).values == both);
}

namespace {

// Returns 60 records of plates in front of two zones. The lateral position of the plate determines
// how the light is shared between the zones.
Dataset plates_in_zones() {
  Dataset data = load_plates(60);
  const Rows rows = all_rows(data.size());
  const SceneModel scene = learn_scene(depth_maps(data), rows, data.map);
  const Matrix pixel = photons(data);
  photons(data) = Matrix(rows.size(), 2 * pixel.cols), photons(data).axis.zones = Zones(2);
  for (const std::size_t row : rows) {
    const float tangent =
        place_of(depth_maps(data).row(row), scene.background, scene.grid)->tangent;
    for (std::size_t c = 0; c < pixel.cols; ++c) {
      photons(data).row(row)[c] = (0.5f - tangent) * pixel.row(row)[c];
      photons(data).row(row)[pixel.cols + c] = (0.5f + tangent) * pixel.row(row)[c];
    }
  }
  return data;
}

}  // namespace

TEST_CASE("depth maps that are mirrored or upside down contradict the zones") {
  Dataset data = plates_in_zones();
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
  const TrainedModel model = train(plates_in_zones(), options);
  REQUIRE(model.estimators.size() == 2);
  CHECK(model.estimators[1].name == "factorised");
}

TEST_CASE("a model of zones refuses zones in another order, mirrored or without directions") {
  const Folder dir;
  nine_zones(24).write(dir / "a");
  TrainOptions options = quiet_options("ridge");
  options.inputs = "spd";
  const Dataset data = load({dir / "a"});
  const TrainedModel model = train(data, options);
  const std::vector<std::pair<std::function<void(Zones&)>, std::string>> changes{
      {[](Zones&) {}, "no error"},
      {[](Zones& zones) { zones[4].x += 0.009; }, "no error"},
      {[](Zones& zones) { std::swap(zones[3], zones[5]); },
       "zone 3 is at x 0.33, y -0.02 (tangents), expected x -0.29, y -0.03; are the zones in "
       "another order?"},
      {[](Zones& zones) {
         for (Zone& zone : zones) zone.y = -zone.y;
       },
       ": zone 0 is at"},
      {[](Zones& zones) { zones[4].width = 0.5; }, "zone 4 has width 0.50 (tangents), expected "},
      {[](Zones& zones) { zones = Zones(zones.size()); },
       "the directions of the zones are unknown, expected known"},
      {[](Zones& zones) { zones.pop_back(); }, "8 zones, expected 9"}};
  for (const auto& [change, text] : changes) {
    Dataset changed = data;
    change(photons(changed).axis.zones);
    CHECK_THAT(error_of([&] { prepare_records(model, changed); }), Contains(text));
  }
}
