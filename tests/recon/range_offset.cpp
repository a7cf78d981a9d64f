// SPDX-License-Identifier: MIT
// Tests that the range bias in the calibration of a run and the value of the option --range-offset
// are subtracted from radar ranges.

#include "recon/data/shift.hpp"
#include "world.hpp"

namespace {

const Axis wide_bins = {"radar", "binned_power", "m", 11, 0.25, 0.5, 1};

// Returns a function that shifts the radar profile of a record to longer ranges.
Change longer_by(double metres) {
  return
      [metres](FusedRecord& r) { power(r) = Shift(-metres / radar_axis().step).apply(power(r)); };
}

}  // namespace

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

TEST_CASE("a dead radar is detected after range calibration, offset correction and binning") {
  const Folder dir;
  a_run(3, 1,
        [](FusedRecord& r) {
          if (r.index == 1) std::fill(power(r).begin(), power(r).end(), 0.25f);
        })
      .offset(Sensor::radar, 0.06)
      .write(dir / "run");
  Dataset data = load({dir / "run"});
  for (const auto& change :
       std::vector<std::function<void()>>{[] {}, [&] { subtract_range_offset(data, 0.05); },
                                          [&] { rebin_radar(data, wide_bins); }}) {
    change();
    CHECK(fault_of(data, 0, Inputs::fused).empty());
    CHECK(fault_of(data, 1, Inputs::fused) == "radar is the same in every bin");
  }
}

TEST_CASE("evaluate and reconstruct subtract the value of --range-offset from radar ranges") {
  const ReconFolder dir;
  a_run(200).write(dir / "train");
  a_run(100, 2).write(dir / "fresh");
  a_run(100, 2, longer_by(0.06)).write(dir / "long");
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
  for (const std::string how : {"", " --follow"}) {
    dir.done("reconstruct m long --force -q --format mm --range-offset 0.06 --out maps" + how);
    CHECK_THAT(contents(dir / "maps/run.txt"), Catch::EndsWith("range offset 0.06 m\n"));
    const auto map =
        thresholded_map(within_span(expected.row(3), model.first().scene), model.first().scene);
    const auto found = picture(dir / "maps/000003_mm.png");
    REQUIRE(found.size() == map.size());
    for (std::size_t p = 0; p < map.size(); ++p)
      REQUIRE(std::abs(static_cast<double>(found[p]) - 1000 * double{map[p]}) <= 1);
  }
  dir.refuses("evaluate m long --range-offset 6cm", 2, "--range-offset");
}
