// SPDX-License-Identifier: MIT
#include "recon/slip.hpp"

#include "recon/evaluate.hpp"
#include "recon/shift.hpp"
#include "recon/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::Folder;
using echofuse::testing::recon_program;
using echofuse::testing::write_run;

namespace {

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

const SlipReference& reference() {
  static const SlipReference known = [] {
    const Dataset data = run_of(800, 1);
    return SlipReference(data, all_rows(data.size()));
  }();
  return known;
}

Slip slip_of(const Dataset& data) {
  std::vector<float> found;
  reference().measure(data, found);
  return reference().judge(found);
}

}  // namespace

TEST_CASE("a slip of the radar against the SPD is found from records without labels") {
  for (const double slip_m : {0.05, -0.03}) {
    Dataset data = run_of(800, 2, longer_by(slip_m));
    std::fill(data.depth.values.begin(), data.depth.values.end(), 0.f);
    const Slip slip = slip_of(data);
    CHECK(slip.verdict == Slip::Verdict::found);
    CHECK(slip.records == 800);
    CHECK(slip.metres == Approx(slip_m).margin(0.01));
    CHECK(std::abs(slip.metres - slip_m) < 4 * slip.error);
    CHECK_THAT(slip.text(true),
               Catch::Contains(slip_m > 0 ? "longer" : "shorter") && Catch::EndsWith("corrected"));
    shorten_radar(data, slip.metres);
    CHECK(slip_of(data).verdict == Slip::Verdict::none);
  }
}

TEST_CASE("no slip is found where there is none, whatever the gains and the noise") {
  for (std::uint64_t seed = 3; seed < 8; ++seed) {
    Dataset data = run_of(400, seed);
    for (float& v : data.radar.values) v *= 4;
    CHECK(slip_of(data).verdict == Slip::Verdict::none);
    CHECK(slip_of(data).text(true).empty());
  }
}

TEST_CASE("people who stand elsewhere than in training are no slip") {
  // Only the records of one side, or of one place.
  Dataset data = run_of(1600, 9);
  const auto keep = [&](double from, double to) {
    Dataset part = data;
    std::vector<float> one;
    for (std::size_t row = 0; row < data.size(); ++row) {
      const auto scene = data.depth.row(row);
      double moment = 0, sum = 0;
      for (std::size_t p = 0; p < scene.size(); ++p)
        if (scene[p] > 0) sum += 1, moment += static_cast<double>(p % 64) - 31.5;
      if (moment / sum < from || moment / sum > to) part.valid[row] = 0;
    }
    return slip_of(part);
  };
  CHECK(keep(3, 32).verdict == Slip::Verdict::unclear);
  CHECK(keep(5, 10).verdict == Slip::Verdict::unclear);
  CHECK_THAT(keep(3, 32).text(true), Catch::Contains("cannot tell"));
}

TEST_CASE("a few records tell nothing, a dead radar neither") {
  const Slip slip = slip_of(run_of(30, 2, longer_by(0.05)));
  CHECK(slip.verdict == Slip::Verdict::few);
  CHECK_THAT(slip.text(true), Catch::Contains("30 records with a body are too few"));
  Dataset dead = run_of(100, 2);
  std::fill(dead.radar.values.begin(), dead.radar.values.end(), 0.f);
  CHECK(slip_of(dead).records == 0);
}

TEST_CASE("reconstruct and evaluate correct a slip, and say so") {
  const Folder dir;
  write_run(dir / "train", 600);
  write_run(dir / "fresh", 300, 2);
  write_run(dir / "slipped", 300, 2, longer_by(0.06));
  REQUIRE(recon_program("train " + dir / "train" + " --out " + dir / "m.h5" +
                        " --model factorised-4 -q")
              .code == 0);
  const auto evaluated = [&](const std::string& rest) {
    return recon_program("evaluate " + dir / "m.h5" + " " + dir / rest).text;
  };
  const auto iou_of = [&](const std::string& text) {
    return std::stod(text.substr(text.find("\niou") + 4));
  };
  const double clean = iou_of(evaluated("fresh"));
  const std::string corrected = evaluated("slipped");
  CHECK_THAT(corrected,
             Catch::Contains("longer than in training") && Catch::Contains(": corrected"));
  CHECK(iou_of(corrected) > 0.95 * clean);
  CHECK(iou_of(evaluated("slipped --slip ignore")) < 0.9 * clean);
  CHECK_THAT(evaluated("slipped --slip warn"), Catch::Contains("not corrected; calibrate anew"));
  const auto maps = [&](const std::string& how) {
    return recon_program("reconstruct " + dir / "m.h5" + " " + dir / "slipped" + " --format npz" +
                         " --out " + dir / "maps-" + how + " --slip " + how);
  };
  CHECK_THAT(maps("correct").text, Catch::Contains(": corrected"));
  CHECK_THAT(maps("warn").text, Catch::Contains("not corrected"));
  CHECK_THAT(maps("ignore").text, !Catch::Contains("corrected"));
}
