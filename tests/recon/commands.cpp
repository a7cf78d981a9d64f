// SPDX-License-Identifier: MIT
// Tests the command line of echofuse-recon: exit codes, error texts, output and files.
#include <signal.h>

#include "recon/data/shift.hpp"
#include "recon/predict/trained_model.hpp"
#include "world.hpp"

namespace {

// Returns true if echofuse-recon has installed its handler for SIGINT (signal 2). Before exec(),
// the process still has the name and the signal handlers of the test program.
bool catches_interrupts(pid_t process) {
  const std::string status = contents("/proc/" + std::to_string(process) + "/status");
  if (!status.starts_with("Name:\techofuse-recon\n")) return false;
  const auto at = status.find("SigCgt:");
  REQUIRE(at != std::string::npos);
  return std::stoull(status.substr(at + 7), nullptr, 16) & 2u;
}

}  // namespace

TEST_CASE("train refuses a data set that exceeds the memory before reading it") {
  const ReconFolder dir;
  a_run(3).write(dir / "run");
  const auto pages = static_cast<double>(sysconf(_SC_PHYS_PAGES));
  const auto records = pages * static_cast<double>(sysconf(_SC_PAGESIZE)) / 25e3;
  damage(dir / "run", "?1 empty records from 1000 on", {std::llround(records)});
  dir.refuses("train run --out m", 1, "of memory, but this machine has ");
  damage(dir / "run", "without the records after ?1", {1000});
  dir.done("train -q --model mean run --out m");
}

TEST_CASE("too few records, damaged records or different axes cause a one-line error") {
  const ReconFolder dir;
  a_run(1).write(dir / "one"), a_run(1, 2).write(dir / "one more");
  a_run(8, 1, [](FusedRecord& r) {
    if (r.index == 6) power(r)[0] = std::numeric_limits<float>::infinity();
  }).write(dir / "bad");
  a_run(4).radar({"radar", "power", "m", 24, 0, 0.3, 1}).write(dir / "other");
  const std::string model = made_model("ridge", 40);
  dir.refuses("train one --out m", 1, "1 usable records");
  dir.refuses("train bad --out m", 1, "record 6");
  CHECK_FALSE(std::filesystem::exists(dir / "m"));
  dir.refuses("evaluate " + model + " bad", 1, "record 6");
  for (const std::string command : {"evaluate ", "reconstruct --out o "})
    dir.refuses(command + model + " other", 1, "radar axis");
  dir.done("evaluate " + model + " 'one more'");
}

TEST_CASE("evaluate --json prints all metrics and costs") {
  const ReconFolder dir;
  a_run(120).write(dir / "run"), a_run(20, 3).write(dir / "fresh");
  dir.done("train run --out m -q --model mlp-32-16 --epochs 30");
  const auto json = dir.json("evaluate m run");
  CHECK((json["model"] == "mlp" && json["inputs"] == "fused" && json["records"] == 12));
  for (const char* name : {"iou", "ssim", "ssim_hard", "ssim_fg", "rmse_m", "rmse_fg_m",
                           "depth_mae_m", "lateral_m", "ghost", "left_right"}) {
    CAPTURE(name);
    CHECK((json["metrics"][name].contains("mean") && json["metrics"][name].contains("se")));
    for (const char* row : {"empty", "mean", "nearest"}) CHECK(json["trivial"][row].contains(name));
  }
  for (const char* name :
       {"multiply_adds", "parameters", "infer_us_median", "infer_us_p99", "train_s", "model_bytes"})
    CHECK(json["cost"][name] > 0);
  CHECK(json["cost"]["multiply_adds"] == 54 * 32 + 32 * 16 + 16 * 4096);
  // The run "fresh" has no training records among which to search for the nearest neighbour. The
  // option --train supplies such records.
  CHECK(dir.json("evaluate m fresh")["trivial"].size() == 2);
  const auto lent = dir.json("evaluate m fresh --train run");
  CHECK((lent["trivial"].size() == 3 && lent["records"] == 20));
}

TEST_CASE("the nearest-record baseline does not depend on the evaluated model") {
  const ReconFolder dir;
  const auto nearest = [&](const std::string& kind, const Words& words) {
    const std::string model = made_model(kind, 100, 1, words);
    return dir.json("evaluate " + model + " " + made_run(100)).at("trivial").at("nearest");
  };
  const auto expected = nearest("ridge", {});
  CHECK(nearest("ridge", {"--inputs", "spd"}) == expected);
  CHECK(nearest("factorised-4", {"--epochs", "2"}) == expected);
}

TEST_CASE("reconstruct continues after a damaged record") {
  const ReconFolder dir;
  const std::string model = made_model("ridge", 60);
  a_run(6, 2, [](FusedRecord& r) {
    if (r.index == 1) power(r)[5] = std::numeric_limits<float>::quiet_NaN();
    if (r.index == 2) std::ranges::fill(power(r), 0.25f);
    if (r.index == 3) lose(r, Sensor::spd);
    // The ground-truth map is missing, as it would be in live use.
    if (r.index == 4) lose(r, Sensor::depth);
  }).write(dir / "mixed");
  dir.says("reconstruct " + model + " mixed --out maps",
           {"record 1", "record 3", "record 2: radar is the same in every bin"}, 5);
  const std::string csv = contents(dir / "maps/records.csv");
  CHECK(std::count(csv.begin(), csv.end(), '\n') == 7);
  CHECK_THAT(csv, Contains("\n0,\"ok\"") && Contains("\n4,\"ok\""));
  CHECK_FALSE(std::filesystem::exists(dir / "maps/000001.png"));
  CHECK(std::filesystem::exists(dir / "maps/000004.png"));
  CHECK(std::ranges::max(picture(dir / "maps/000000_mm.png")) > 1500);
}

TEST_CASE("models with different sensors are compared only on records that all of them can use") {
  const ReconFolder dir;
  const auto run = [&](const std::string& name, std::int64_t records, std::uint64_t seed,
                       const Change& change) {
    a_run(records, seed, change).radar(radar_axis(32)).write(dir / name);
  };
  run("run", 120, 1, {});
  run("fresh", 60, 8, [](FusedRecord& r) {
    if (r.index % 4 == 0) lose(r, Sensor::radar);
  });
  const std::string train = "train -q --model ridge --set fallback=false run --out ";
  for (const std::string rest :
       {"fused --set radar_bin_m=0.5", "spd --inputs spd", "radar --inputs radar"})
    dir.done(train + rest);
  const auto assessed = [&](const std::string& models) {
    return dir.json("evaluate " + models + " fresh --per-record table.csv");
  };
  const nlohmann::json all = assessed("fused spd radar");
  for (const auto& row : all["rows"]) CHECK(row["records"] == 45);
  CHECK(all["rows"][1]["left_out"] == 15);
  CHECK(all["paired"][0]["metrics"]["iou"]["records"] == 45);
  const std::string table = contents(dir / "table.csv");
  CHECK(std::count(table.begin(), table.end(), '\n') == 1 + 3 * 45);
  // `compare` must compute the same differences as `evaluate`. It reads the scores of each record
  // from a table.
  const nlohmann::json methods = dir.json("compare table.csv")["methods"];
  REQUIRE(methods.size() == 3);
  for (const char* key : {"mean", "low", "high"})
    CHECK(methods[2]["difference"]["iou"][key].get<double>() ==
          Approx(all["paired"][1]["metrics"]["iou"][key].get<double>()).margin(1e-6));
  const nlohmann::json iou = methods[0]["metrics"]["iou"], mean = all["metrics"]["iou"]["mean"];
  CHECK(iou["mean"].get<double>() == Approx(mean.get<double>()));
  CHECK((iou["low"] < mean && mean < iou["high"]));
  // A model that uses only the SPD can evaluate all 60 records. If a model is compared with itself,
  // both scores are equal.
  CHECK(assessed("spd")["records"] == 60);
  const nlohmann::json twice = assessed("fused fused");
  CHECK(twice["rows"][0]["metrics"] == twice["rows"][1]["metrics"]);
  CHECK(twice["metrics"] == assessed("fused")["metrics"]);
  CHECK(twice["paired"][0]["metrics"]["iou"]["high"] == 0);
}

TEST_CASE("compare averages the lines of each record and refuses lines without a record number") {
  const ReconFolder dir;
  std::ofstream(dir / "a.csv") << "record,name,iou,lateral_m\n7,a,0.2,\n7,a,0.4,0.1\n8,a,0.5,\n";
  const nlohmann::json a = dir.json("compare a.csv")["methods"][0];
  CHECK(a["records"] == 2);
  CHECK(a["metrics"]["iou"]["mean"].get<double>() == Approx(0.4));
  CHECK(a["metrics"]["lateral_m"]["records"] == 1);
  std::ofstream(dir / "b.csv") << "record,name,iou\n7,a,0.2\n,a,0.4\n";
  dir.refuses("compare b.csv", 1, "a line contains no record index");
}

TEST_CASE("interrupted training saves the best model so far, or only the main model") {
  const ReconFolder dir;
  a_run(200).write(dir / "run"), a_run(1000).write(dir / "long");
  const auto interrupt = [&](const std::string& run, const std::string& out, Words words,
                             useconds_t after_us) {
    words.insert(words.begin(), {"train", dir / run, "--out", dir / out, "-q"});
    const pid_t child = start_recon(words);
    while (!catches_interrupts(child)) ::usleep(1'000);
    ::usleep(after_us);
    CHECK(exit_code(child, SIGINT) == 130);
  };
  interrupt("run", "m", {"--epochs", "100000"}, 500'000);
  dir.done("evaluate m run");
  // The ridge fit does not react to the interrupt, so training stops only after this fit, before
  // the fallback is fitted.
  interrupt("long", "n", {"--model", "ridge"}, 0);
  CHECK(recon::load_model(dir / "n").estimators.size() == 1);
}
