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
  a_run(400, 3).write(dir / "more"), a_run(60, 2, late_by(1)).write(dir / "fresh late");
  const auto said = "late: histogram ranges fit the depth maps 1 record later";
  CHECK(late_truth(load({dir / "good"})).empty());
  CHECK_THAT(late_truth(load({dir / "late"})),
             Contains(said) && Contains("1 record late; shift them by 1 record"));
  for (const std::size_t lag : {2, 3, 5})
    CHECK_THAT(late_truth(load_plates(120, 1, late_by(lag))),
               Contains("are " + std::to_string(lag) + " records late"));
  // The camera loses frames during the run.
  const auto lost = [](std::size_t i) -> std::size_t {
    return i < 60 ? 1 : i < 100 ? 0 : i < 130 ? 2 : 3;
  };
  a_run(240, 1, late_by(lost)).write(dir / "run");
  // Each run is tested separately.
  const std::string lines = late_truth(load({dir / "more", dir / "run"}));
  CHECK(std::ranges::count(lines, '\n') == 2);
  for (const char* text :
       {"run: records 0 to 58: ", "are 1 record late; shift them by 1 record\n",
        "run: records 98 to 126: ", "are 2 records late; shift them by 2 records\n",
        "run: records 127 to 239: ", "are 3 records late; shift them by 3 records"})
    CHECK_THAT(lines, Contains(text));
  Dataset early = load({dir / "good"});
  for (std::size_t row = 0; row + 1 < early.size(); ++row)
    std::ranges::copy(depth_maps(early).row(row + 1), depth_maps(early).row(row).begin());
  CHECK_THAT(late_truth(early), Contains("1 record early"));
  CHECK_THAT(late_truth(load({dir / "more", dir / "late"})), Contains(said));
  const std::string train = "train --model ridge --set fallback=false ";
  dir.says(train + "late --out no", {said});
  dir.done(train + "-q good --out m");
  CHECK_THAT(dir.json("evaluate m 'fresh late'")["notes"].get<std::string>(),
             Contains("1 record late"));
}

TEST_CASE(
    "evaluate reports mirrored depth maps, and train refuses them unless a setting accepts them") {
  const ReconFolder dir;
  a_run(60).write(dir / "good"), a_run(60, 2, mirror).write(dir / "mirrored");
  a_run(29, 2, mirror).write(dir / "few"), a_run(60, 2, late_by(1)).write(dir / "late");
  a_run(60, 3, [](FusedRecord& r) { lose(r, Sensor::radar); }).write(dir / "no radar");
  const std::string evaluate = "-q evaluate " + made_model("ridge", 200);
  CHECK_THAT(dir.done(evaluate + " --all good"), !Contains(" side "));
  dir.says(evaluate + " mirrored", {"show bodies on the wrong side", "flip the depth maps"});
  dir.says(evaluate + " few", {"the predicted side is wrong for"});
  CHECK(mirrored_camera(load({dir / "good", dir / "no radar"})).empty());
  CHECK_THAT(mirrored_camera(load({dir / "good", dir / "mirrored"})),
             Contains("mirrored: the depth maps show bodies on the wrong"));
  const std::string train = "-q train --model mean-shape --set fallback=false --out ";
  dir.done(train + "m good");
  for (const std::string& command : {train + "a", std::string("-q train --from m --out b")})
    dir.refuses(command + " mirrored", 1, "--set mirrored=take uses the maps as they are");
  dir.done(train + "c --set mirrored=take mirrored");
  dir.says("train --from m --out d late", {"1 record late", "cross-validation: unchanged\n"});
}

TEST_CASE("evaluate does not score maps of training records, also in comparison with a model") {
  const ReconFolder dir;
  const std::string first = made_run(60), model = made_model("ridge", 60);
  // Copies of the training records in a second run are recognised as training records.
  a_run(70).write(dir / "copy");
  dir.done("-q reconstruct --format npy " + model + " " + first + " --out maps");
  dir.done("-q reconstruct --format npy " + model + " copy --out copied");
  const auto assessed = [&](const std::string& words) {
    return dir.json("evaluate " + words + " " + first);
  };
  const auto maps = assessed("--maps maps"), both = assessed("--maps maps " + model);
  CHECK((maps["records"] == 6 && maps["left_out"]["trained on"] == 54));
  CHECK(both["records"] == 6);
  CHECK(both["rows"][1]["metrics"] == assessed(model)["metrics"]);
  for (const std::string& more : {std::string(), model})
    CHECK(assessed("--all --maps maps " + more)["records"] == 60);
  dir.says("-q evaluate --maps maps " + first, {"\n54 of 60 records left out: trained on 54\n"});
  dir.says("-q evaluate --maps copied copy", {"\n54 of 70 records left out: trained on 54\n"});
}
