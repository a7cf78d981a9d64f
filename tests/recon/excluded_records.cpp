// SPDX-License-Identifier: MIT
// Tests which records are excluded from training and evaluation: damaged, dead, doubtful and
// duplicate records.

#include "recon/data/copies.hpp"
#include "world.hpp"

namespace {

const std::string train_ridge = "train --model ridge --set fallback=false ";

// Shows the plate of a scene. Two records of a scene differ by their noise and by 3 mm.
void show(FusedRecord& r, std::int64_t scene, std::int64_t noise) {
  Rng place = make_rng(1, static_cast<std::uint64_t>(scene)),
      rng = make_rng(2, static_cast<std::uint64_t>(noise));
  std::uniform_real_distribution<double> x(-1, 1), z(3, 4);
  std::normal_distribution<double> off(0, 0.003);
  const double at_x = x(place), at_z = z(place) + off(rng);
  r = plate_record(r.index, at_x, at_z, rng);
}

void stop_camera(FusedRecord& r) {
  set_verdict(r, Sensor::depth, "stands still: the same as before");
}

void dim(FusedRecord& r) { set_verdict(r, Sensor::spd, "weak: 12 clicks above the background"); }

}  // namespace

TEST_CASE("damaged and dead records are counted, and a run with more than 10 % is refused") {
  const Folder dir;
  const auto load_with = [&](std::int64_t damaged, std::int64_t dead) {
    std::filesystem::remove(dir / "a");
    a_run(50, 1, [&](FusedRecord& r) {
      r.slot_end = r.slot_start + std::chrono::seconds(3);
      // The limit is 100 million clicks per second.
      counts(r)[7] = r.index < damaged ? 300'000'001 : 300'000'000;
      if (r.index >= 50 - dead) std::ranges::fill(counts(r), 0u);
    }).write(dir / "a");
    return load({dir / "a"});
  };
  const auto rows_with = [&](std::int64_t damaged, std::int64_t dead,
                             Inputs inputs = Inputs::fused) {
    return rows_to_train(load_with(damaged, dead), inputs).rows.size();
  };
  CHECK_THROWS_WITH(rows_with(0, 6), Contains("a: record 44: spd is the same in every bin; the "
                                              "sensor is dead, or the room is empty and dark; 6"));
  CHECK(rows_with(0, 6, Inputs::radar) == 50);
  for (const auto& [damaged, dead] : {std::pair{6, 0}, {3, 3}, {0, 6}})
    CHECK_THROWS_WITH(rows_with(damaged, dead),
                      Contains("6 of 50 records are dead or damaged (limit 10 %)"));
  for (const auto& [damaged, dead] : {std::pair{5, 0}, {3, 2}, {0, 5}})
    CHECK(rows_with(damaged, dead) == 45);
  const Dataset data = load_with(2, 0);
  CHECK((data.size() == 48 && data.damaged.size() == 2));
  CHECK_THAT(to_text(data.damaged.back()),
             Contains("record 1: spd bin 7 contains 300000001 clicks, more than"));
  std::vector<std::int64_t> bad;
  load_part(record::RunReader(dir / "a"), 0, 50, sensors_of(Inputs::fused),
            [&](std::int64_t index, const std::string&) { bad.push_back(index); });
  CHECK(bad == std::vector<std::int64_t>{0, 1});
}

TEST_CASE("records with lost frames are counted, and are used unless a setting excludes them") {
  const ReconFolder dir;
  const auto lossy = [](FusedRecord& r) {
    if (r.index == 1)
      set_verdict(r, Sensor::depth, "lossy: 50 % of the 90 expected frames received");
    if (r.index == 2)
      set_verdict(r, Sensor::radar, "lossy: 50 % of the 60 expected frames received");
    if (r.index == 3) dim(r);
  };
  a_run(40, 1, lossy).write(dir / "a"), a_run(40, 2, lossy).write(dir / "b");
  const std::string train_mean = "train --model mean a --out ";
  dir.says(train_mean + "m", {"2 lossy records are used; --set lossy=leave excludes them"});
  dir.says(train_mean + "n --set lossy=leave",
           {"\n3 of 40 records left out: SPD weak 1, camera lossy 1, radar lossy 1"});
  dir.says("rows b --model m", {"; left out: SPD weak 1\n"});
  dir.says("rows b --model n", {"SPD weak 1", "radar lossy 1"});
  dir.says("rows a --inputs spd --set lossy=leave", {"; left out: SPD weak 1, camera lossy 1\n"});
}

TEST_CASE("the rows command prints the split part of each record or the reason for its exclusion") {
  const ReconFolder dir;
  const auto change = [](FusedRecord& r) {
    if (r.index == 1) set_verdict(r, Sensor::radar, "weak: the echo is 0.05 of the usual");
    if (r.index == 2) stop_camera(r);
    if (r.index == 3) r.valid.erase(Sensor::radar);
    if (r.index == 4) power(r)[3] = std::numeric_limits<float>::quiet_NaN();
    if (r.index == 5) std::ranges::fill(counts(r), 7u);
    if (r.index == 6) set_verdict(r, Sensor::spd, "saturated: 0.2 clicks per laser pulse");
    if (r.index == 7) set_verdict(r, Sensor::spd, "no peak: no bins clearly exceed the mean");
    if (r.index == 8) r.valid.erase(Sensor::depth);
    if (r.index == 9) r.valid.erase(Sensor::spd);
  };
  a_run(60, 1, change).write(dir / "a"), a_run(8).write(dir / "b");
  const auto rows = [&](const std::string& words) { return dir.json("rows " + words)["records"]; };
  const auto reasons = [](const nlohmann::json& records) {
    Words out;
    for (const auto& row : records) out.push_back(row.value("left_out", ""));
    return out;
  };
  const nlohmann::json both = rows("a b");
  REQUIRE(both.size() == 68);
  CHECK(both[67]["run"] == "b");
  Words expected(60);
  expected[1] = "radar weak", expected[2] = "camera stands still", expected[3] = "radar missing";
  expected[4] = "damaged", expected[5] = "the same in every bin", expected[6] = "SPD saturated";
  expected[8] = "camera missing", expected[9] = "SPD missing";
  CHECK(reasons(rows("a")) == expected);
  expected[1] = expected[3] = "";
  CHECK(reasons(rows("a --inputs spd")) == expected);
  CHECK(reasons(both)[60] == "also in a");
  dir.done("train -q --model mean --seed 3 a --out m");
  // The model was also trained with the split seed 3, so both splits must agree.
  const nlohmann::json split = rows("a --seed 3"), own = rows("a --model m");
  const auto parts = [](const nlohmann::json& records) {
    Words out;
    for (const auto& row : records) out.push_back(row.value("part", ""));
    return out;
  };
  CHECK(parts(split) == parts(own));
  const auto assessed = [&](const std::string& run) {
    return dir.json("evaluate m " + run)["records"];
  };
  CHECK(assessed("a") == std::ranges::count(parts(own), "test"));
  // All records of run b are copies of records of run a. The model was trained on run a.
  const nlohmann::json fresh = rows("b --model m");
  for (const auto& row : fresh) CHECK((row.contains("part") || row["left_out"] == "trained on"));
  CHECK(assessed("b") == std::ranges::count(parts(fresh), "test"));
  const nlohmann::json blocked = rows("a --split blocked --set gap=2");
  CHECK(blocked[59]["part"] == "test");
  CHECK(std::ranges::count(reasons(blocked), "in the gap between the parts of the split") == 4);
  CHECK(dir.recon("rows --seed 2 a --model m").code == 2);
}

TEST_CASE("train and evaluate print the number of excluded records and the reasons") {
  const ReconFolder dir;
  const auto doubtful = [](FusedRecord& r) {
    if (r.index < 8) stop_camera(r);
    // The object is moved sideways, so that these maps are not copies of other maps.
    if (r.index < 8) std::ranges::rotate(depth_mm(r), depth_mm(r).begin() + 12);
    if (r.index == 8) dim(r);
    if (r.index == 9) std::ranges::fill(counts(r), 0u);
    if (r.index == 10) counts(r)[5] = 4'294'967'295u;
    if (r.index == 11) r.valid.erase(Sensor::radar);
  };
  a_run(60, 1, doubtful).write(dir / "run");
  dir.says(
      train_ridge + "run --out m",
      {"\n12 of 60 records left out: SPD weak 1, camera stands still 8, damaged 1, radar missing "
       "1, the same in every bin 1 (",
       "record 10: spd bin 5 contains 4294967295 clicks"});
  dir.says(train_ridge + "run --out all --set doubtful=take",
           {"\n3 of 60 records left out: damaged 1, radar missing 1, "});
  a_run(30, 2, [&](FusedRecord& r) {
    if (r.index < 8) doubtful(r);
  }).write(dir / "fresh");
  dir.says("evaluate -q m fresh",
           {"\n22 records; ",
            "doubtful records left out: camera stands still 8; including them: IoU 0."});
  a_run(4, 2, doubtful).write(dir / "frozen");
  for (const std::string command : {"evaluate -q m frozen", "train -q frozen --out no"})
    dir.refuses(command, 1, "frozen: 4 of 4 records left out: camera stands still 4");
}

TEST_CASE("copies of a record are used once in training and are excluded from evaluation") {
  const ReconFolder dir;
  a_run(60).write(dir / "a"), a_run(20).write(dir / "b"), a_run(20, 2).write(dir / "c");
  a_run(70).write(dir / "more");
  a_run(60, 1, [](FusedRecord& r) { show(r, r.index % 30, r.index % 30); }).write(dir / "twice");
  dir.says(train_ridge + "--set test_share=0 a b c --out abc",
           {"\n20 of 100 records left out: also in a 20\n"});
  dir.says(train_ridge + "twice --out no", {"\n30 of 60 records left out: twice in the run 30\n"});
  dir.done(train_ridge + "-q --set test_share=0 a --out m");
  const std::string evaluate = "evaluate -q m ";
  dir.refuses(evaluate + "b", 1, "all records of this run are copies of training records");
  dir.says(evaluate + "twice", {"\n30 records; ", "twice in the run 30"});
  dir.says(
      evaluate + "more",
      {"\n10 records; ", "60 of 70 records are copies of training records and are left out\n"});
  dir.says(evaluate + "more --all",
           {"\n70 records; ", "copies of training records and are scored\n"});
  // The records of run d are nearly identical to those of run c. The nearest neighbour of an
  // evaluated record must not be its own copy.
  a_run(40, 2, [](FusedRecord& r) { power(r)[20] += 0.01f; }).write(dir / "d");
  CHECK(dir.json(evaluate + "c --train d")["trivial"]["nearest"]["iou"]["mean"] < 0.9);
}

TEST_CASE("a record with identical photon counts is a copy even if other data differ") {
  const auto records = a_run(60).made();
  Copies originals;
  for (std::size_t row = 0; row < 60; ++row)
    CHECK(originals.first(fingerprint_of(records[row]), row) == row);
  const auto times = [](FusedRecord& r, std::uint32_t by) {
    for (std::uint32_t& count : counts(r)) count *= by;
  };
  const auto found = [&](const Change& change) {
    int out = 0;
    for (std::size_t row = 0; row < 60; ++row) {
      FusedRecord r = records[row];
      change(r);
      out += originals.first(fingerprint_of(r), 99) == row;
    }
    return out;
  };
  CHECK(found([](FusedRecord& r) { std::ranges::fill(power(r), 7.f); }) == 60);
  CHECK(found([](FusedRecord& r) { lose(r, Sensor::radar); }) == 60);
  CHECK(found([](FusedRecord& r) { r.label = "other"; }) == 60);
  CHECK(found([](FusedRecord& r) { ++counts(r)[0]; }) == 60);
  CHECK(found([](FusedRecord& r) { counts(r).resize(34); }) == 60);
  CHECK(found([&](FusedRecord& r) { times(r, 3); }) == 60);
  CHECK(found([&](FusedRecord& r) { times(r, 2), --*std::ranges::max_element(counts(r)); }) == 60);
  // The shift drops the last bin, which belongs to the fingerprints of a few narrow returns.
  CHECK(found([](FusedRecord& r) {
          counts(r).insert(counts(r).begin(), 0), counts(r).pop_back();
        }) >= 54);
}

TEST_CASE("a copy of a narrow return is recognised") {
  FusedRecord r;
  r.accept(Sensor::spd);
  counts(r) = {5, 4, 6, 5, 3, 900, 60'000, 1200, 5, 6, 4, 5, 7, 5, 4, 6};
  const std::int64_t original = fingerprint_of(r);
  CHECK(original != 0);
  for (std::uint32_t& count : counts(r)) count *= 2;
  CHECK(fingerprint_of(r) == original);
  ++counts(r)[6];
  CHECK(fingerprint_of(r) != original);
}

TEST_CASE("records of a still scene are not copies of each other") {
  Rng rng = make_rng(4, 0);
  FusedRecord r;
  r.accept(Sensor::spd);
  for (const double clicks : {300.0, 3e3, 1e5}) {
    Copies copies;
    for (std::size_t i = 0; i < 5000; ++i) {
      counts(r).clear();
      for (int bin = 0; bin < 100; ++bin) {
        const double mean = 0.5 + clicks / 12 * std::exp(-0.5 * std::pow((bin - 40) / 5.0, 2));
        counts(r).push_back(std::poisson_distribution<std::uint32_t>(mean)(rng));
      }
      const std::int64_t fingerprint = fingerprint_of(r);
      if (fingerprint == 0 || copies.first(fingerprint, i) != i) FAIL_CHECK(clicks);
    }
  }
}

TEST_CASE("records with few clicks or bins, or with weak or frozen counts, are not copies") {
  const auto with_peak = [](FusedRecord& r, std::uint32_t background, std::uint32_t peak) {
    std::ranges::fill(counts(r), background);
    counts(r)[8] += peak;
  };
  const Dataset data = load_plates(8, 1, [&](FusedRecord& r) {
    if (r.index == 0) with_peak(r, 0, 99);
    // Record 1 has only 99 clicks above a bright background, which is too few for a content hash.
    if (r.index == 1) with_peak(r, 1000, 99);
    if (r.index == 2) dim(r);
    if (r.index == 3) set_verdict(r, Sensor::spd, "stands still: the same");
    // The peak of record 4 covers only three bins. The same peak may occur again by chance, so
    // no content hash is computed for the record.
    if (r.index == 4) with_peak(r, 0, 300), counts(r)[7] = counts(r)[9] = 4;
    if (r.index == 5) with_peak(r, 1000, 101);
  });
  for (std::size_t row = 0; row < 8; ++row) CHECK((data.records[row].content == 0) == (row < 5));
}

TEST_CASE("runs without records, and sensors without data or with dead data, are refused") {
  const ReconFolder dir;
  a_run(40).write(dir / "a");
  dir.done("train -q --model mean a --out m");
  damage(dir / "a", "histograms without counts in the records from ?1 to ?2", {0, 39});
  dir.says("evaluate m a", {"no valid held-out record is left"}, 1);
  damage(dir / "a", "without records");
  dir.refuses("train -q --model mean a --out n", 1, "contains no record to train on");
  const auto run = [&](const std::string& name, Sensor lost) {
    a_run(12, 1, [&](FusedRecord& r) { r.valid.erase(lost); }).write(dir / name);
    return "train " + name + " --out n";
  };
  dir.refuses(run("blind", Sensor::radar), 1, "no record has radar data; use --inputs spd");
  dir.refuses(run("dark", Sensor::spd), 1, "no record has SPD data; use --inputs radar");
  dir.refuses(run("without_maps", Sensor::depth), 1, "no record has a depth map");
}

TEST_CASE("train warns about similar neighbours of a random split, and about repeated scenes") {
  const ReconFolder dir;
  // The same scene is repeated after `scenes` records, but with different noise.
  const auto recurring = [](std::int64_t scenes) {
    return [scenes](FusedRecord& r) { show(r, r.index % scenes, r.index); };
  };
  a_run(240, 1, [](FusedRecord& r) { show(r, r.index / 12, r.index); }).write(dir / "held");
  a_run(240, 1, recurring(30)).write(dir / "recurring");
  a_run(240, 1, recurring(120)).write(dir / "pairs"), a_run(240).write(dir / "free");
  a_run(240, 1, [](FusedRecord& r) {
    if (r.index % 3) std::ranges::fill(depth_mm(r), std::uint16_t{0});
  }).write(dir / "empty");
  const auto said = [&](const std::string& name, const std::string& split) {
    std::filesystem::remove(dir / "m");
    return dir.done("train --model mean --out m " + name + " --split " + split);
  };
  CHECK_THAT(said("held", "random"),
             Contains("consecutive records are alike") && Contains("use --split blocked"));
  CHECK_THAT(said("held", "blocked"), !Contains("alike"));
  for (const std::string split : {"random", "blocked"}) {
    CAPTURE(split);
    CHECK_THAT(said("recurring", split), Contains("scenes recur: 24 of 24 held-out depth maps") &&
                                             Contains("evaluate on a run of other scenes"));
    CHECK_THAT(said("pairs", split), Contains("scenes recur: "));
    for (const std::string name : {"free", "empty"})
      CHECK_THAT(said(name, split), !Contains("scenes recur") && !Contains("alike"));
  }
}
