// SPDX-License-Identifier: MIT
#include "recon/uncertainty/range_bias.hpp"

#include <fstream>

#include "recon/data/shift.hpp"
#include "recon/estimator/evaluate.hpp"
#include "recon/estimator/train.hpp"
#include "recon/uncertainty/range_bias_evidence.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::contents;
using echofuse::testing::Folder;
using echofuse::testing::radar_axis;
using echofuse::testing::recon_program;
using echofuse::testing::write_run;

namespace {

const Axis wide_bins = {"radar", "binned_power", "m", 11, 0.25, 0.5, 1};

// Where the body of a record is, in pixels to the right of the middle.
double place_of(const Dataset& data, std::size_t row) {
  const auto scene = data.depth.row(row);
  double moment = 0, sum = 0;
  for (std::size_t p = 0; p < scene.size(); ++p)
    if (scene[p] > 0) sum += 1, moment += static_cast<double>(p % 64) - 31.5;
  return moment / sum;
}

int count_of(const std::string& word, const std::string& text) {
  int count = 0;
  for (auto at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++count;
  return count;
}

// Moves a record's profile to longer ranges.
testing::Change longer_by(double metres) {
  return [metres](record::FusedRecord& r) {
    r.radar = Shift(-metres / testing::radar_axis().step).apply(r.radar);
  };
}

Dataset run_of(std::int64_t count, std::uint64_t seed, const testing::Change& change = {}) {
  const Folder dir;
  write_run(dir / "run", count, seed, change);
  return load({dir / "run"});
}

struct Reference {
  Dataset data;
  Preprocessing preprocessing{data, all_rows(data.size()), Inputs::fused, {}, true};
  RangeBiasReference reference{preprocessing.alignment, data, preprocessing.aligned,
                               all_rows(data.size())};
  explicit Reference(const testing::Change& change = {}) : data(run_of(800, 1, change)) {}
};

RangeBias range_bias_of(const Dataset& data, const Reference& known, const GainCheck& gains = {}) {
  const Features raw = fit_features(known.data, {0}, Inputs::fused, raw_scaling);
  const Matrix aligned = known.preprocessing.alignment(raw.raw_inputs(data, all_rows(data.size())));
  return known.reference.judge(known.preprocessing.alignment, data, aligned, gains);
}

RangeBias range_bias_of(const Dataset& data) {
  static const Reference known;
  return range_bias_of(data, known);
}

// A reflector between the radar and the people.
void add_reflector(record::FusedRecord& r) {
  for (std::uint32_t i = 0; i < r.radar.size(); ++i)
    r.radar[i] +=
        0.05f * static_cast<float>(std::exp(-std::pow((radar_axis().at(i) - 1.1) / 0.4, 2)));
}

// People further to the right by so much, in front of it.
testing::Change to_the_right(double metres, std::uint64_t seed) {
  return [=, rng = make_rng(seed, 3)](record::FusedRecord& r) mutable {
    std::uniform_real_distribution<double> x(-1 + metres, 1 + metres), z(3, 4);
    const double at = x(rng);
    r = testing::plate_record(r.index, at, z(rng), rng);
    add_reflector(r);
  };
}

}  // namespace

TEST_CASE("a range bias of the radar against the SPD is found from records without labels") {
  for (const double range_bias_m : {0.05, -0.03}) {
    Dataset data = run_of(800, 2, longer_by(range_bias_m));
    std::fill(data.depth.values.begin(), data.depth.values.end(), 0.f);
    const RangeBias range_bias = range_bias_of(data);
    CHECK(range_bias.status == RangeBias::Status::detected);
    CHECK(range_bias.records == 800);
    CHECK(range_bias.bias_m == Approx(range_bias_m).margin(0.01));
    CHECK(std::abs(range_bias.bias_m - range_bias_m) < 4 * range_bias.standard_error_m);
    CHECK_THAT(range_bias.text(true), Catch::Contains(range_bias_m > 0 ? "longer" : "shorter") &&
                                          Catch::EndsWith("corrected"));
    subtract_range_offset(data, range_bias.bias_m);
    CHECK(range_bias_of(data).status == RangeBias::Status::not_detected);
  }
}

TEST_CASE("no range bias is found where there is none, whatever gains, noise and the crowd") {
  for (std::uint64_t seed = 3; seed < 8; ++seed) {
    const auto check = [&](const Dataset& data) {
      CHECK(range_bias_of(data).status == RangeBias::Status::not_detected);
      CHECK(range_bias_of(data).text(true).empty());
    };
    const Dataset data = run_of(800, seed);
    Dataset louder = data, noisy = data, crowded = data;
    for (float& v : louder.radar.values) v *= 4;
    check(louder);
    Rng rng = make_rng(seed, 1);
    std::normal_distribution<float> noise(0, 0.02f);  // ten times the training's
    for (float& v : noisy.radar.values) v += noise(rng);
    check(noisy);
    for (std::size_t row = 0; row < data.size(); row += 2)  // half as many on the right
      if (place_of(data, row) > 0) crowded.valid[row] = 0;
    check(crowded);
  }
}

TEST_CASE("poses that are held for some records are no range bias") {
  int found = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng = make_rng(seed, 3);
    std::uniform_real_distribution<double> any_x(-1, 1), any_z(3, 4);
    double x = 0, z = 0;
    const Dataset data = run_of(100, seed, [&](record::FusedRecord& r) {
      if (r.index % 10 == 0) x = any_x(rng), z = any_z(rng);
      r = testing::plate_record(r.index, x, z, rng);
    });
    found += range_bias_of(data).status == RangeBias::Status::detected;
  }
  CHECK(found <= 1);  // 3, were the records taken for independent
}

TEST_CASE("people who spread otherwise than in training are no range bias") {
  // Only the records of one side, or of one place.
  Dataset data = run_of(1600, 9);
  const auto keep = [&](double from, double to) {
    Dataset part = data;
    for (std::size_t row = 0; row < data.size(); ++row)
      if (place_of(data, row) < from || place_of(data, row) > to) part.valid[row] = 0;
    return range_bias_of(part);
  };
  CHECK(keep(3, 32).status == RangeBias::Status::inconsistent);
  CHECK(keep(5, 10).status == RangeBias::Status::inconsistent);
  CHECK_THAT(keep(3, 32).text(true), Catch::Contains("cannot tell"));
}

TEST_CASE("people who all stand further to one side look like a range bias, a seventh as long") {
  Rng rng = make_rng(1, 3);
  std::uniform_real_distribution<double> x(-0.7, 1.3), z(3, 4);
  const RangeBias range_bias = range_bias_of(run_of(800, 2, [&](record::FusedRecord& r) {
    const double at = x(rng);
    r = testing::plate_record(r.index, at, z(rng), rng);
  }));
  CHECK(range_bias.status == RangeBias::Status::detected);
  CHECK(range_bias.bias_m == Approx(0.3 / 7).margin(0.01));
  CHECK_THAT(range_bias.text(false), Catch::Contains("or people further to one side"));
}

TEST_CASE("what stands still tells a range bias from people to one side") {
  const Reference known(add_reflector);
  const auto both = [&](double metres) {
    return [=](record::FusedRecord& r) { add_reflector(r), longer_by(metres)(r); };
  };
  for (const double metres : {0.04, -0.04}) {
    const RangeBias biased = range_bias_of(run_of(300, 2, both(metres)), known);
    REQUIRE(biased.status == RangeBias::Status::detected);
    CHECK(biased.evidence.says == RangeBiasEvidence::Says::range_bias);
    CHECK_THAT(biased.text(false),
               Catch::Contains("so it is a range bias") && Catch::Contains("--range-bias correct"));
    // It decides also where people or sensors are others.
    CHECK_THAT(biased.text(false, true), Catch::Contains("--range-bias correct"));
  }
  const RangeBias right = range_bias_of(run_of(300, 2, to_the_right(0.3, 1)), known);
  REQUIRE(right.status == RangeBias::Status::detected);
  CHECK(right.evidence.says == RangeBiasEvidence::Says::no_range_bias);
  CHECK_THAT(right.text(false), Catch::Contains("people stand to one side or reflect otherwise") &&
                                    Catch::EndsWith("not corrected"));
  // Nothing stood still in the other reference's training.
  CHECK(range_bias_of(run_of(300, 2, longer_by(0.04))).evidence.text.empty());
}

TEST_CASE("empty records tell by themselves how far the echoes have moved") {
  const Reference known(add_reflector);
  const Dataset data = run_of(300, 2, [](record::FusedRecord& r) {
    if (r.index % 10 == 0) {
      std::fill(r.spd.begin(), r.spd.end(), 0u), r.spd[3] = 1;
      std::fill(r.radar.begin(), r.radar.end(), 0.f);
    }
    add_reflector(r), longer_by(0.04)(r);
  });
  const RangeBias biased = range_bias_of(data, known);
  REQUIRE(biased.status == RangeBias::Status::detected);
  CHECK_THAT(biased.text(false), Catch::Contains("cm in 30 empty records, so it is a range bias"));
}

TEST_CASE("six empty records state an error as large as their noise makes it") {
  const Reference known(add_reflector);
  const StaticEchoes echoes(known.data, all_rows(known.data.size()));
  const Features raw = fit_features(known.data, {0}, Inputs::fused, raw_scaling);
  Rng rng = make_rng(3, 3);
  std::normal_distribution<float> noise(0, 0.01f);
  double squares = 0, stated = 0;
  constexpr int runs = 12;
  for (std::uint64_t seed = 1; seed <= runs; ++seed) {
    const Dataset data = run_of(6, seed, [&](record::FusedRecord& r) {
      std::fill(r.spd.begin(), r.spd.end(), 0u), r.spd[3] = 1;
      std::fill(r.radar.begin(), r.radar.end(), 0.f);
      add_reflector(r);
      for (float& power : r.radar) power += noise(rng);
    });
    const Matrix aligned = known.preprocessing.alignment(raw.raw_inputs(data, all_rows(6)));
    const EchoMove move = echoes.judge(data, aligned, true);
    REQUIRE(move.empty_records == 6);
    squares += move.moved_m * move.moved_m, stated += move.standard_error_m;
  }
  CHECK(stated / runs > 0.4 * std::sqrt(squares / runs));
}

TEST_CASE("in front of walls what stands still tells a range bias alone") {
  const auto wall = [](double metres) {
    return [=](record::FusedRecord& r) {
      for (std::uint32_t i = 0; i < r.radar.size(); ++i)
        r.radar[i] +=
            2 * static_cast<float>(std::exp(-std::pow((radar_axis().at(i) - 5.2) / 0.4, 2)));
      if (metres != 0) longer_by(metres)(r);
    };
  };
  const Reference known(wall(0));
  CHECK_FALSE(known.reference.knows_bodies());
  const RangeBias biased = range_bias_of(run_of(100, 2, wall(0.03)), known);
  CHECK(biased.status == RangeBias::Status::detected);
  CHECK(biased.bias_m == Approx(0.03).margin(0.005));
  CHECK_THAT(biased.text(false), Catch::Contains("of what stands still"));
  CHECK(range_bias_of(run_of(100, 2, wall(0)), known).status == RangeBias::Status::not_detected);
}

TEST_CASE("too much noise to see a range bias is said, not taken for none") {
  Dataset data = run_of(60, 2);
  Rng rng = make_rng(1, 1);
  std::normal_distribution<float> noise(0, 0.1f);
  for (float& v : data.radar.values) v += noise(rng);
  const RangeBias range_bias = range_bias_of(data);
  CHECK(range_bias.status == RangeBias::Status::too_few_records);
  CHECK(4 * range_bias.standard_error_m > 0.03);
  CHECK_THAT(range_bias.text(true), Catch::Contains("too few to tell") && Catch::Contains("error"));
}

TEST_CASE("a calibration's offset and a range bias are taken off a profile in one interpolation") {
  const Folder dir;
  write_run(dir / "run", 3, 1, {}, testing::radar_axis(), testing::spd_axis(),
            {{Sensor::radar, "2026-01-01T00:00:00Z", "", 1, 0.06, 0.001}});
  write_run(dir / "plain", 3, 1);
  const Dataset plain = load({dir / "plain"});
  const auto moved = [&](double metres, std::size_t row) {
    const auto profile = plain.radar.row(row);
    return Shift(metres / plain.radar_axis.step).apply({profile.begin(), profile.end()});
  };
  const Dataset calibrated = load({dir / "run"});
  Dataset recorded = load_recorded({dir / "run"});
  CHECK(recorded.radar.values == plain.radar.values);
  subtract_range_offset(recorded, 0.05);
  for (std::size_t row = 0; row < 3; ++row) {
    CHECK(std::ranges::equal(calibrated.radar.row(row), moved(0.06, row)));
    CHECK(std::ranges::equal(recorded.radar.row(row), moved(0.06 + 0.05, row)));
  }
  subtract_range_offset(recorded, 0);  // there is nothing left to take off
  CHECK(std::ranges::equal(recorded.radar.row(1), moved(0.06 + 0.05, 1)));
}

TEST_CASE("a dead radar is seen in a calibrated run, after a correction and in wide bins") {
  const Folder dir;
  write_run(dir / "run", 3, 1,
            [](record::FusedRecord& r) {
              if (r.index == 1) std::fill(r.radar.begin(), r.radar.end(), 0.25f);
            },
            testing::radar_axis(), testing::spd_axis(),
            {{Sensor::radar, "2026-01-01T00:00:00Z", "", 1, 0.06, 0.001}});
  Dataset data = load({dir / "run"});
  for (int corrected = 0; corrected < 2; ++corrected) {
    CHECK(data.fault_of(0, Inputs::fused).empty());
    CHECK(data.fault_of(1, Inputs::fused) == "radar is the same in every bin");
    subtract_range_offset(data, 0.05);
  }
  rebin_radar(data, wide_bins);
  CHECK(data.fault_of(0, Inputs::fused).empty());
  CHECK(data.fault_of(1, Inputs::fused) == "radar is the same in every bin");
}

TEST_CASE(
    "of radar power in wide bins nothing is learnt, and older models without a range bias correct "
    "none") {
  const Folder dir;
  write_run(dir / "train", 150);
  write_run(dir / "biased", 100, 2, longer_by(0.06));
  TrainOptions options;
  options.model = "ridge", options.fit.quiet = true;
  Dataset data = load({dir / "train"});
  TrainedModel older = train(data, options);
  CHECK(older.range_bias.known());
  older.range_bias = {};
  save_model(older, dir / "older");
  CHECK_FALSE(load_model(dir / "older").range_bias.known());
  const auto o = recon_program("reconstruct -q " + dir / "older" + " " + dir / "biased" +
                               " --range-bias correct --out " + dir / "o");
  CHECK(o.code == 0);
  CHECK(o.text.empty());
  rebin_radar(data, wide_bins);
  CHECK_FALSE(train(data, options).range_bias.known());
}

TEST_CASE("a few records tell nothing, a dead radar neither") {
  const RangeBias range_bias = range_bias_of(run_of(30, 2, longer_by(0.05)));
  CHECK(range_bias.status == RangeBias::Status::too_few_records);
  CHECK_THAT(range_bias.text(true),
             Catch::Contains("30 records with a body, and those of the training, are too few"));
  Dataset dead = run_of(100, 2);
  std::fill(dead.radar.values.begin(), dead.radar.values.end(), 0.f);
  CHECK(range_bias_of(dead).records == 0);
  CHECK(range_bias_of(dead).text(true).empty());
}

TEST_CASE("reconstruct and evaluate warn of a range bias, or correct it") {
  const Folder dir;
  write_run(dir / "train", 400);
  write_run(dir / "fresh", 200, 2);
  write_run(dir / "biased", 200, 2, longer_by(0.06));
  REQUIRE(recon_program("train " + dir / "train" + " --out " + dir / "m.h5" +
                        " --model factorised-4 --no-fallback -q")
              .code == 0);
  const auto evaluated = [&](const std::string& rest) {
    return recon_program("evaluate " + dir / "m.h5" + " " + dir / rest).text;
  };
  const auto iou_of = [&](const std::string& text) {
    return std::stod(text.substr(text.find("\niou") + 4));
  };
  const double clean = iou_of(evaluated("fresh"));
  const std::string corrected = evaluated("biased --range-bias correct");
  CHECK_THAT(corrected,
             Catch::Contains("longer than in training") && Catch::Contains(": corrected"));
  CHECK(iou_of(corrected) > 0.95 * clean);
  CHECK(iou_of(evaluated("biased --range-bias ignore")) < 0.9 * clean);
  CHECK_THAT(evaluated("biased"),
             Catch::Contains("nothing in the records tells which, so not corrected"));
  const auto maps = [&](const std::string& how) {
    return recon_program("reconstruct " + dir / "m.h5" + " " + dir / "biased" + " --format npz" +
                         " --out " + dir / "maps-" + how + " --range-bias " + how);
  };
  CHECK_THAT(maps("correct").text, Catch::Contains(": corrected"));
  CHECK_THAT(contents(dir / "maps-correct/records.csv"), Catch::Contains(",0.06"));
  CHECK_THAT(maps("warn").text, Catch::Contains("not corrected"));
  CHECK(count_of(",0.0000,", contents(dir / "maps-warn/records.csv")) == 200);
  CHECK_THAT(maps("ignore").text, !Catch::Contains("corrected"));

  write_run(dir / "short", 30, 2);
  const std::string brief =
      "reconstruct " + dir / "m.h5" + " " + dir / "short" + " --out " + dir / "short-maps";
  CHECK_THAT(recon_program(brief).text,
             Catch::Contains("30 records with a body, and those of the training, are too few"));
  CHECK(recon_program(brief + " -q").text.empty());
}

TEST_CASE("while following, a range bias that comes late is told once, and not corrected") {
  const Folder dir;
  write_run(dir / "train", 400);
  REQUIRE(recon_program("train " + dir / "train" + " --out " + dir / "m.h5" +
                        " --model factorised-4 --no-fallback -q")
              .code == 0);
  const auto shift = longer_by(0.06);
  write_run(dir / "live", 1300, 2, [&](record::FusedRecord& r) {
    if (r.index >= 700) shift(r);
  });
  const auto follow = [&](const std::string& how) {
    return recon_program("reconstruct " + dir / "m.h5" + " " + dir / "live" +
                         " --follow --range-bias " + how + " --format npz --out " + dir / how)
        .text;
  };
  CHECK(count_of("longer than in training", follow("correct")) == 1);
  CHECK(count_of(",0.0000,", contents(dir / "correct/records.csv")) == 1300);
  CHECK(count_of("longer than in training", follow("ignore")) == 0);
}
