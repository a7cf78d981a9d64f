// SPDX-License-Identifier: MIT
// Tests the warnings about depth maps that contradict the other sensors, and the scoring of written
// maps.

#include "recon/data/late_truth.hpp"
#include "recon/metrics/mirrored_camera.hpp"
#include "world.hpp"

namespace {

// Returns a function that replaces the depth map of each record with the depth map of the record
// `lag(record)` positions earlier.
Change late_by(std::function<std::size_t(std::size_t)> lag) {
  return [lag, last = std::vector<std::vector<std::uint16_t>>()](FusedRecord& r) mutable {
    last.push_back(depth_mm(r));
    const std::size_t of = std::min(lag(last.size() - 1), last.size() - 1);
    depth_mm(r) = last[last.size() - 1 - of];
  };
}

Change late_by(std::size_t lag) {
  return late_by([lag](std::size_t) { return lag; });
}

void mirror(FusedRecord& r) {
  for (std::size_t row = 0; row < 64; ++row)
    std::reverse(depth_mm(r).begin() + static_cast<std::ptrdiff_t>(64 * row),
                 depth_mm(r).begin() + static_cast<std::ptrdiff_t>(64 * (row + 1)));
}

}  // namespace

TEST_CASE("train and evaluate report depth maps that belong to other records") {
  const ReconFolder dir;
  a_run(120).write(dir / "good"), a_run(120, 1, late_by(1)).write(dir / "late");
  const auto said = "late: histogram ranges fit the depth maps 1 record later";
  CHECK(late_truth(load({dir / "good"})).empty());
  CHECK_THAT(late_truth(load({dir / "late"})),
             Catch::Contains(said) && Catch::Contains("1 record late; shift them by 1 record"));
  for (const std::size_t lag : {2, 3, 5})
    CHECK_THAT(late_truth(load_plates(120, 1, late_by(lag))),
               Catch::Contains("are " + std::to_string(lag) + " records late"));
  // The camera loses frames during the run.
  const auto lost = [](std::size_t i) -> std::size_t {
    return i < 60 ? 1 : i < 100 ? 0 : i < 130 ? 2 : 3;
  };
  const std::string lines = late_truth(load_plates(240, 1, late_by(lost)));
  CHECK(std::ranges::count(lines, '\n') == 2);
  CHECK_THAT(lines, Catch::Contains("run: records 0 to 58: ") &&
                        Catch::Contains("are 1 record late; shift them by 1 record\n") &&
                        Catch::Contains("run: records 98 to 126: ") &&
                        Catch::Contains("are 2 records late; shift them by 2 records\n") &&
                        Catch::Contains("run: records 127 to 239: ") &&
                        Catch::Contains("are 3 records late; shift them by 3 records"));
  Dataset early = load({dir / "good"});
  for (std::size_t row = 0; row + 1 < early.size(); ++row)
    std::ranges::copy(depth_maps(early).row(row + 1), depth_maps(early).row(row).begin());
  CHECK_THAT(late_truth(early), Catch::Contains("1 record early"));
  // If there are several runs, each run is tested separately.
  a_run(400, 3).write(dir / "more");
  CHECK_THAT(late_truth(load({dir / "more", dir / "late"})), Catch::Contains(said));
  const std::string train = "train --model ridge --set fallback=false ";
  CHECK_THAT(dir.recon(train + "late --out no").text, Catch::Contains(said));
  dir.done(train + "-q good --out m");
  a_run(60, 2, late_by(1)).write(dir / "fresh late");
  CHECK_THAT(dir.json("evaluate m 'fresh late'")["notes"].get<std::string>(),
             Catch::Contains("1 record late"));
}

TEST_CASE("evaluate reports mirrored depth maps and how to correct them") {
  const ReconFolder dir;
  a_run(60, 2).write(dir / "fresh");
  a_run(60, 2, mirror).write(dir / "mirrored");
  const std::string evaluate = "-q evaluate " + made_model("ridge", 200);
  CHECK_THAT(dir.done(evaluate + " fresh"), !Catch::Contains(" side "));
  CHECK_THAT(dir.done(evaluate + " mirrored"), Catch::Contains("show bodies on the wrong side") &&
                                                   Catch::Contains("flip the depth maps"));
  a_run(29, 2, mirror).write(dir / "few");
  CHECK_THAT(dir.done(evaluate + " few"), Catch::Contains("the predicted side is wrong for"));
}

TEST_CASE(
    "train refuses runs with a mirrored camera, also for --from, unless a setting takes them") {
  const ReconFolder dir;
  a_run(60).write(dir / "good"), a_run(60, 2, mirror).write(dir / "mirrored");
  a_run(60, 3, [](FusedRecord& r) { lose(r, Sensor::radar); }).write(dir / "no radar");
  CHECK(mirrored_camera(load({dir / "good", dir / "no radar"})).empty());
  CHECK_THAT(mirrored_camera(load({dir / "good", dir / "mirrored"})),
             Catch::Contains("mirrored: the depth maps show bodies on the wrong"));
  const std::string train = "-q train --model mean-shape --set fallback=false --out ";
  dir.done(train + "m good");
  for (const std::string& command : {train + "a", std::string("-q train --from m --out b")})
    dir.refuses(command + " mirrored", 1, "--set mirrored=take uses the maps as they are");
  dir.done(train + "c --set mirrored=take mirrored");
  a_run(60, 2, late_by(1)).write(dir / "late");
  CHECK_THAT(dir.recon("train --from m --out d late").text, Catch::Contains("1 record late"));
}

TEST_CASE("evaluate does not score maps of training records") {
  const ReconFolder dir;
  const std::string first = made_run(60);
  const std::string model = made_model("ridge", 60);
  dir.done("-q reconstruct --format npy " + model + " " + first + " --out maps");
  const auto assessed = [&](const std::string& words) {
    return dir.json("evaluate --maps maps " + first + words);
  };
  CHECK(assessed("")["records"] == 6);
  CHECK(assessed("")["left_out"]["trained on"] == 54);
  CHECK(assessed(" --all")["records"] == 60);
  CHECK_THAT(dir.recon("-q evaluate --maps maps " + first).text,
             Catch::Contains("54 of 60 records left out: trained on 54\n"));
  // Copies of the training records in a second run are recognised as training records.
  a_run(70).write(dir / "copy");
  dir.done("-q reconstruct --format npy " + model + " copy --out copied");
  CHECK_THAT(dir.recon("-q evaluate --maps copied copy").text,
             Catch::Contains("54 of 70 records left out: trained on 54\n"));
}

TEST_CASE("evaluate does not score maps of doubtful records") {
  const ReconFolder dir;
  a_run(40, 1, [](FusedRecord& r) {
    if (r.index < 10) set_verdict(r, Sensor::depth, "stands still: the same as before");
  }).write(dir / "run");
  const std::string model = made_model("ridge", 60, 2);
  dir.done("-q reconstruct --format npy " + model + " run --out maps");
  CHECK_THAT(dir.recon("-q evaluate --maps maps run").text,
             Catch::StartsWith("30 records; ") &&
                 Catch::Contains("10 of 40 records left out: camera stands still 10\n"));
}
