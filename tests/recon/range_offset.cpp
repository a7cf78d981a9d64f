// SPDX-License-Identifier: MIT
// Tests that radar profiles are shifted by the range bias in the calibration of a run and by the
// value of the option --range-offset.

#include "recon/data/shift.hpp"
#include "world.hpp"

namespace {

// Returns the power of a point echo after a matched filter. The sampling interval is half the range
// resolution, so a narrower echo could not be represented by the samples.
std::vector<float> echo(double place) {
  std::vector<float> out;
  for (int i = 0; i < 40; ++i) {
    const double u = (i - place) / 2;
    out.push_back(static_cast<float>(std::pow(u == 0 ? 1 : std::sin(M_PI * u) / (M_PI * u), 2)));
  }
  return out;
}

// Returns a function that shifts the radar profile of a record to longer ranges.
Change longer_by(double metres) {
  return
      [metres](FusedRecord& r) { power(r) = Shift(-metres / radar_axis().step).apply(power(r)); };
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

TEST_CASE("the calibration offset and --range-offset are applied in one interpolation") {
  const Folder dir;
  a_run(3).offset(Sensor::radar, 0.06).write(dir / "run");
  const Dataset plain = load_plates(3);
  const auto moved = [&](double metres, std::size_t row) {
    const auto profile = profiles(plain).row(row);
    return Shift(metres / profiles(plain).axis.step).apply({profile.begin(), profile.end()});
  };
  const Dataset calibrated = load({dir / "run"});
  Dataset recorded = load_recorded({dir / "run"});
  CHECK(profiles(recorded).values == profiles(plain).values);
  subtract_range_offset(recorded, 0.05);
  for (std::size_t row = 0; row < 3; ++row) {
    CHECK(std::ranges::equal(profiles(calibrated).row(row), moved(0.06, row)));
    CHECK(std::ranges::equal(profiles(recorded).row(row), moved(0.06 + 0.05, row)));
  }
  // Subtracting an offset of 0 must not change the profile.
  subtract_range_offset(recorded, 0);
  CHECK(std::ranges::equal(profiles(recorded).row(1), moved(0.06 + 0.05, 1)));
}

TEST_CASE("evaluate and reconstruct subtract the value of --range-offset from radar ranges") {
  const ReconFolder dir;
  a_run(200).write(dir / "train");
  a_run(100, 2).write(dir / "fresh"), a_run(100, 2, longer_by(0.06)).write(dir / "long");
  dir.done("train train --out m --model factorised-4 --set fallback=false -q");
  const auto iou_of = [&](const std::string& rest) {
    return dir.json("evaluate m " + rest)["metrics"]["iou"]["mean"].get<double>();
  };
  const double clean = iou_of("fresh");
  CHECK(iou_of("long") < 0.9 * clean);
  CHECK(iou_of("long --range-offset 0.06") > 0.95 * clean);
  CHECK(iou_of("fresh --range-offset 0") == clean);
  const TrainedModel model = load_model(dir / "m");
  const Records records = prepare_records(model, load_recorded({dir / "long"}), 0.06);
  const Matrix expected = predict(model, records.data, all_rows(100), PredictionDetail::maps).maps;
  const SceneModel& scene = model.first().scene;
  const auto map = thresholded_map(within_span(expected.row(3), scene), scene);
  for (const std::string how : {"", " --follow"}) {
    dir.done("reconstruct m long --force -q --format mm --range-offset 0.06 --out maps" + how);
    CHECK_THAT(contents(dir / "maps/run.txt"), EndsWith("range offset 0.06 m\n"));
    const auto found = picture(dir / "maps/000003_mm.png");
    REQUIRE(found.size() == map.size());
    for (std::size_t p = 0; p < map.size(); ++p)
      REQUIRE(std::abs(static_cast<double>(found[p]) - 1000 * double{map[p]}) <= 1);
  }
  dir.refuses("evaluate m long --range-offset 6cm", 2, "--range-offset");
}
