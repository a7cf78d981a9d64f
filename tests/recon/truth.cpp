// SPDX-License-Identifier: MIT
// Tests the warnings about depth maps that contradict the other sensors, and the scoring of written
// maps.
#include <nlohmann/json.hpp>

#include "recon/data/late_truth.hpp"
#include "recon/metrics/mirrored_camera.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::test;

namespace {

// Returns a function that replaces the depth map of each record from record `from` on with the
// depth map of the record `lag` positions earlier.
Change late_by(int lag, std::size_t from = 0) {
  return [lag, from, last = std::vector<std::vector<std::uint16_t>>()](FusedRecord& r) mutable {
    last.push_back(depth_mm(r));
    if (last.size() <= from) return;
    const std::size_t of = std::min<std::size_t>(static_cast<std::size_t>(lag), last.size() - 1);
    depth_mm(r) = last[last.size() - 1 - of];
  };
}

void mirror(FusedRecord& r) {
  for (std::size_t row = 0; row < 64; ++row)
    std::reverse(depth_mm(r).begin() + static_cast<std::ptrdiff_t>(64 * row),
                 depth_mm(r).begin() + static_cast<std::ptrdiff_t>(64 * (row + 1)));
}

}  // namespace

TEST_CASE("train and evaluate report depth maps that belong to other records") {
  const Folder dir;
  a_run(120).write(dir / "good"), a_run(120, 1, late_by(1)).write(dir / "late");
  const auto said = (dir / "late") + ": histogram ranges fit the depth maps 1 record later";
  CHECK(late_truth(load({dir / "good"})).empty());
  CHECK_THAT(late_truth(load({dir / "late"})),
             Catch::StartsWith(said) && Catch::Contains("1 record late; shift them by 1 record"));
  for (const int lag : {2, 3, 5}) {
    a_run(120, 1, late_by(lag)).write(dir / ("late" + std::to_string(lag)));
    CHECK_THAT(late_truth(load({dir / ("late" + std::to_string(lag))})),
               Catch::Contains("are " + std::to_string(lag) + " records late"));
  }
  // The camera loses two frames in the middle of the run.
  a_run(240, 1, late_by(2, 130)).write(dir / "half");
  CHECK_THAT(late_truth(load({dir / "half"})), Catch::Contains("half: records 100 to 239: ") &&
                                                   Catch::Contains("are 2 records late"));
  Dataset early = load({dir / "good"});
  for (std::size_t row = 0; row + 1 < early.size(); ++row)
    std::ranges::copy(depth_maps(early).row(row + 1), depth_maps(early).row(row).begin());
  CHECK_THAT(late_truth(early), Catch::Contains("1 record early"));
  // If there are several runs, each run is tested separately.
  a_run(400, 3).write(dir / "more");
  CHECK_THAT(late_truth(load({dir / "more", dir / "late"})), Catch::StartsWith(said));
  const std::string train = "train --model ridge --set fallback=false ";
  CHECK_THAT(recon_program(train + (dir / "late") + " --out " + (dir / "no")).text,
             Catch::Contains(said));
  REQUIRE(recon_program(train + "-q " + (dir / "good") + " --out " + (dir / "m")).code == 0);
  a_run(60, 2, late_by(1)).write(dir / "fresh late");
  const std::string evaluate =
      "-q evaluate --json " + (dir / "m") + " '" + (dir / "fresh late") + "'";
  CHECK_THAT(nlohmann::json::parse(recon_program(evaluate).text)["notes"].get<std::string>(),
             Catch::Contains("1 record late"));
}

TEST_CASE("evaluate reports mirrored depth maps and how to correct them") {
  const Folder dir;
  a_run(60, 2).write(dir / "fresh");
  a_run(60, 2, mirror).write(dir / "mirrored");
  const std::string model = made_model("ridge", 200);
  const auto text = [&](const std::string& run) {
    return recon_program("-q evaluate " + model + " " + run).text;
  };
  CHECK_THAT(text(dir / "fresh"), !Catch::Contains("predicted side"));
  CHECK_THAT(text(dir / "mirrored"), Catch::Contains("the predicted side is wrong for") &&
                                         Catch::Contains("flip the depth maps"));
}

TEST_CASE(
    "train refuses runs with a mirrored camera, also for --from, unless a setting takes them") {
  const Folder dir;
  a_run(60).write(dir / "good"), a_run(60, 2, mirror).write(dir / "mirrored");
  a_run(60, 3, [](FusedRecord& r) { lose(r, Sensor::radar); }).write(dir / "no radar");
  CHECK(mirrored_camera(load({dir / "good", dir / "no radar"})).empty());
  CHECK_THAT(mirrored_camera(load({dir / "good", dir / "mirrored"})),
             Catch::StartsWith((dir / "mirrored") + ": the depth maps show bodies on the wrong"));
  const std::string train = "-q train --model mean-shape --set fallback=false --out ";
  REQUIRE(recon_program(train + (dir / "m") + " " + (dir / "good")).code == 0);
  const auto refused = Catch::Contains("--set mirrored=take uses the maps as they are");
  const Outcome alone = recon_program(train + (dir / "a") + " " + (dir / "mirrored"));
  CHECK(alone.code == 1);
  CHECK_THAT(alone.text, refused);
  CHECK_THAT(recon_program("-q train --from " + (dir / "m") + " " + (dir / "mirrored") + " --out " +
                           (dir / "b"))
                 .text,
             refused);
  CHECK(recon_program(train + (dir / "c") + " --set mirrored=take " + (dir / "mirrored")).code ==
        0);
}

TEST_CASE("evaluate refuses maps of another run and does not score maps of training records") {
  const Folder dir;
  const std::string first = made_run(60);
  a_run(60, 2).write(dir / "b");
  const std::string model = made_model("ridge", 60);
  REQUIRE(recon_program("-q reconstruct --format npy " + model + " " + first + " --out " +
                        (dir / "maps"))
              .code == 0);
  refuses("-q evaluate --maps " + (dir / "maps ") + (dir / "b"), 1,
          "maps: contains maps of another run, " + first);
  const auto assessed = [&](const std::string& words) {
    const auto o = recon_program("-q evaluate --json --maps " + (dir / "maps ") + first + words);
    CAPTURE(o.text);
    REQUIRE(o.code == 0);
    return nlohmann::json::parse(o.text);
  };
  CHECK(assessed("")["records"] == 6);
  CHECK(assessed("")["left_out"]["trained on"] == 54);
  CHECK(assessed(" --all")["records"] == 60);
  CHECK_THAT(recon_program("-q evaluate --maps " + (dir / "maps ") + first).text,
             Catch::Contains("54 of 60 records left out: trained on 54\n"));
  // Copies of the training records in a second run are recognised as training records.
  a_run(70).write(dir / "copy");
  REQUIRE(recon_program("-q reconstruct --format npy " + model + " " + (dir / "copy") + " --out " +
                        (dir / "copied"))
              .code == 0);
  CHECK_THAT(recon_program("-q evaluate --maps " + (dir / "copied ") + (dir / "copy")).text,
             Catch::Contains("54 of 70 records left out: trained on 54\n"));
}

TEST_CASE("evaluate does not score maps of doubtful records") {
  const Folder dir;
  a_run(40, 1, [](FusedRecord& r) {
    if (r.index < 10) set_verdict(r, Sensor::depth, "stands still: the same as before");
  }).write(dir / "run");
  const std::string model = made_model("ridge", 60, 2);
  REQUIRE(recon_program("-q reconstruct --format npy " + model + " " + (dir / "run") + " --out " +
                        (dir / "maps"))
              .code == 0);
  CHECK_THAT(recon_program("-q evaluate --maps " + (dir / "maps ") + (dir / "run")).text,
             Catch::StartsWith("30 records; ") &&
                 Catch::Contains("10 of 40 records left out: camera stands still 10\n"));
}
