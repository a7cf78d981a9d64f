// SPDX-License-Identifier: MIT
// Tests the reference of scores: foreground and background of the evaluated run, or RMSE if the run
// has no foreground.

#include "recon/score/paired.hpp"
#include "world.hpp"

TEST_CASE("scores use the foreground and background of the evaluated run, not those of the model") {
  const ReconFolder dir;
  const auto wall = [](std::uint16_t wall_mm) {
    return [=](FusedRecord& r) { std::ranges::replace(depth_mm(r), 0, wall_mm); };
  };
  a_run(160).write(dir / "open"), a_run(160, 2, wall(5000)).write(dir / "room");
  a_run(60, 3, wall(5000)).write(dir / "fresh"), a_run(60, 3, wall(4700)).write(dir / "nearer");
  for (const std::string run : {"open", "room"})
    dir.done("train -q --model ridge --out of-" + run + " " + run);
  const auto assessed = [&](const std::string& words) {
    return dir.json("evaluate " + words)["trivial"];
  };
  CHECK(assessed("of-open fresh --train room") == assessed("of-room fresh --train room"));
  const double open = assessed("of-open fresh")["empty"]["ssim"]["mean"],
               home = assessed("of-room fresh")["empty"]["ssim"]["mean"];
  CHECK(open == Approx(home).margin(0.01));
  CHECK(home > 0.5);
  const std::string other_room =
      "the room differs from the training room: foreground and background are learnt";
  dir.says("evaluate of-open fresh", {other_room});
  dir.says("evaluate of-room nearer", {other_room});
  CHECK_THAT(dir.done("evaluate of-room fresh"), !Contains("the room differs"));
}

TEST_CASE("a run with a moving wall but without a body is reported and is scored by RMSE") {
  const ReconFolder dir;
  a_run(200, 1, [](FusedRecord& r) {
    Rng rng = make_rng(9, static_cast<std::uint64_t>(r.index));
    const double z = std::uniform_real_distribution<double>(2.6, 4)(rng);
    r = plate_record(r.index, 0, z, rng);
    std::ranges::fill(depth_mm(r), static_cast<std::uint16_t>(1000 * z));
  }).write(dir / "run");
  dir.says("train --model auto --inputs spd --set candidates=empty,mean,ridge run --out m",
           {"no body in front of the background"});
  const auto json = dir.json("evaluate m run");
  CHECK((json["model"] == "ridge" && json["metrics"]["iou"]["mean"].is_null()));
  const double error_m = json["metrics"]["rmse_m"]["mean"],
               stated_m = json["calibration"]["pixel_deviation_m"];
  CHECK(error_m < 0.1);
  CHECK((stated_m > error_m / 2 && stated_m < 2 * error_m));
}

TEST_CASE("the gain of a second method is positive if its error or mirror fraction is smaller") {
  for (const Metric m : {metric_iou, metric_ssim, metric_ssim_fg, metric_left_right})
    CHECK(gain(m, 0.2, 0.5) == Approx(0.3));
  for (const Metric m : {metric_lateral_m, metric_depth_mae_m, metric_rmse_m, metric_ghost})
    CHECK(gain(m, 0.2, 0.5) == Approx(-0.3));
  MapScores one, other;
  one.fill(NAN), other.fill(NAN);
  one[metric_ghost] = 0.75, other[metric_ghost] = 0.25;
  const auto differences = paired_differences(std::vector(6, one), std::vector(6, other));
  REQUIRE(differences.size() == 1);
  const PairedDifference& d = differences[0];
  CHECK(std::tuple(d.metric, d.mean, d.first, d.second) ==
        std::tuple(metric_ghost, 0.5, 0.75, 0.25));
}

TEST_CASE("the confidence interval widens with fewer records and is undefined below five") {
  const auto differences = [](std::size_t records) {
    MapScores none;
    none.fill(NAN);
    std::vector<MapScores> first(records, none), second(records, none);
    Rng rng = make_rng(5, 0);
    std::normal_distribution<double> gain(0.1, 0.2);
    for (std::size_t i = 0; i < records; ++i)
      first[i][metric_iou] = 0.5, second[i][metric_iou] = 0.5 + gain(rng);
    return paired_differences(first, second).at(0);
  };
  for (const std::size_t records : {5u, 9u, 10u, 11u, 40u}) {
    const PairedDifference d = differences(records);
    CAPTURE(records, d.low, d.high);
    // For a standard deviation of 0.2, the width of a 95 % interval is about 0.8 / sqrt(records).
    // The lower limit is smaller, because the variance of a small sample may be low.
    CHECK(d.high - d.low > 0.3 / std::sqrt(records));
    CHECK((d.low < d.mean && d.mean < d.high));
  }
  CHECK((std::isnan(differences(4).low) && std::isnan(differences(4).high)));
}
