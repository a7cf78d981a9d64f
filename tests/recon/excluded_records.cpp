// SPDX-License-Identifier: MIT
// Tests which records are excluded from training and evaluation: damaged, dead, doubtful and
// duplicate records.

#include "recon/data/copies.hpp"
#include "world.hpp"

namespace {

// Shows the plate of a scene. Two records of a scene differ by their noise and by 3 mm.
void show(FusedRecord& r, std::int64_t scene, std::int64_t noise) {
  Rng place = make_rng(1, static_cast<std::uint64_t>(scene)),
      rng = make_rng(2, static_cast<std::uint64_t>(noise));
  std::uniform_real_distribution<double> x(-1, 1), z(3, 4);
  std::normal_distribution<double> off(0, 0.003);
  const double at_x = x(place), at_z = z(place) + off(rng);
  r = plate_record(r.index, at_x, at_z, rng);
}

}  // namespace

TEST_CASE("damaged records are counted, and a run with more than 10 % damaged records is refused") {
  const Folder dir;
  const auto spoil = [&](const std::string& name, std::int64_t from) {
    a_run(20, 1, [&](FusedRecord& r) {
      r.slot_end = r.slot_start + std::chrono::seconds(3);
      if (r.index >= from) power(r)[3] = std::numeric_limits<float>::quiet_NaN();
      // The limit is 100 million clicks per second.
      if (r.index == 4) counts(r)[7] = 300'000'001;
    }).write(dir / name);
  };
  spoil("a", 19);
  const Dataset data = load({dir / "a"});
  CHECK(data.size() == 18);
  REQUIRE(data.damaged.size() == 2);
  CHECK_THAT(to_text(data.damaged.front()),
             Catch::Contains("record 4: spd bin 7 contains 300000001 clicks, more than"));
  spoil("b", 18);
  CHECK_THAT(
      error_of([&] { load({dir / "b"}); }),
      Catch::Contains("record 4: ") && Catch::Contains("3 of 20 records are dead or damaged"));
  std::vector<std::int64_t> bad;
  load_part(record::RunReader(dir / "a"), 0, 20, sensors_of(Inputs::fused),
            [&](std::int64_t index, const std::string&) { bad.push_back(index); });
  CHECK(bad == std::vector<std::int64_t>{4, 19});
}

TEST_CASE("dead and damaged records count together for the limit of 10 %") {
  const Folder dir;
  const auto error_with = [&](std::int64_t damaged, std::int64_t dead) {
    a_run(50, 1, [&](FusedRecord& r) {
      if (r.index < damaged) power(r)[3] = std::numeric_limits<float>::quiet_NaN();
      if (r.index >= 50 - dead) std::ranges::fill(counts(r), 0u);
    }).write(dir / "a");
    const Dataset data = load({dir / "a"});
    CHECK(data.damaged.size() == static_cast<std::size_t>(damaged));
    const std::string error = error_of([&] { rows_to_train(data, Inputs::fused); });
    std::filesystem::remove(dir / "a");
    return error;
  };
  CHECK_THAT(error_with(3, 3), Catch::Contains("6 of 50 records are dead or damaged (limit 10 %)"));
  CHECK(error_with(3, 2) == "no error");
  CHECK(error_with(0, 5) == "no error");
}

TEST_CASE("doubtful records are excluded from training") {
  const Folder dir;
  a_run(8, 1, [](FusedRecord& r) {
    if (r.index == 1) set_verdict(r, Sensor::depth, "stands still: the same as before");
    if (r.index == 2) set_verdict(r, Sensor::radar, "weak: the echo is 0.05 of the usual");
    if (r.index == 3) set_verdict(r, Sensor::spd, "no peak: no bins clearly exceed the mean");
    if (r.index == 4) set_verdict(r, Sensor::spd, "saturated: 0.2 clicks per laser pulse");
  }).write(dir / "a");
  const Dataset data = load({dir / "a"});
  CHECK(doubt_of(data, 0, Inputs::fused).empty());
  CHECK(doubt_of(data, 1, Inputs::fused) == "camera stands still");
  CHECK(doubt_of(data, 2, Inputs::fused) == "radar weak");
  CHECK(doubt_of(data, 2, Inputs::spd).empty());
  CHECK(doubt_of(data, 4, Inputs::spd) == "SPD saturated");
  CHECK(usable(data, Inputs::fused) == Rows{0, 3, 5, 6, 7});
}

TEST_CASE("records with lost frames are counted, and are used unless a setting excludes them") {
  const ReconFolder dir;
  const auto lossy = [](FusedRecord& r) {
    if (r.index == 1)
      set_verdict(r, Sensor::depth, "lossy: 50 % of the 90 expected frames received");
    if (r.index == 2)
      set_verdict(r, Sensor::radar, "lossy: 50 % of the 60 expected frames received");
    if (r.index == 3) set_verdict(r, Sensor::spd, "weak: 12 clicks above the background");
  };
  a_run(40, 1, lossy).write(dir / "a"), a_run(40, 2, lossy).write(dir / "b");
  Dataset data = load({dir / "a"});
  CHECK(usable(data, Inputs::fused).size() == 39);
  const std::string train = "train --model mean a --out ";
  CHECK_THAT(dir.recon(train + "m").text,
             Catch::Contains("2 lossy records are used; --set lossy=leave excludes them"));
  CHECK_THAT(
      dir.recon(train + "n --set lossy=leave").text,
      Catch::Contains("3 of 40 records left out: SPD weak 1, camera lossy 1, radar lossy 1"));
  for (const auto& [model, text] : {std::pair{"m", "SPD weak 1"}, {"n", "radar lossy 1"}})
    CHECK_THAT(dir.recon(std::string("rows b --model ") + model).text, Catch::Contains(text));
  data.exclusions.lossy = true;
  CHECK(usable(data, Inputs::spd).size() == 38);
}

TEST_CASE("the rows command prints the split part of each record or the reason for its exclusion") {
  const ReconFolder dir;
  const auto change = [](FusedRecord& r) {
    if (r.index == 2) set_verdict(r, Sensor::depth, "stands still: the same as before");
    if (r.index == 3) r.valid.erase(Sensor::radar);
    if (r.index == 4) power(r)[3] = std::numeric_limits<float>::quiet_NaN();
    if (r.index == 5) std::ranges::fill(counts(r), 7u);
  };
  a_run(60, 1, change).write(dir / "a"), a_run(8).write(dir / "b");
  const auto rows = [&](const std::string& words) { return dir.json("rows " + words)["records"]; };
  const nlohmann::json both = rows("a b");
  REQUIRE(both.size() == 68);
  const auto why = [&](std::size_t i) { return both[i].value("left_out", ""); };
  CHECK(why(2) == "camera stands still");
  CHECK(why(3) == "radar missing");
  CHECK(why(4) == "damaged");
  CHECK(why(5) == "the same in every bin");
  CHECK(why(60) == "also in a");
  CHECK(both[67]["run"] == "b");
  dir.done("train -q --model mean --seed 3 a --out m");
  // The model was also trained with the split seed 3, so both splits must agree.
  const nlohmann::json split = rows("a --seed 3");
  const nlohmann::json own = rows("a --model m");
  std::size_t held_out = 0;
  for (std::size_t i = 0; i < split.size(); ++i) {
    CHECK(split[i].value("part", "") == own[i].value("part", ""));
    held_out += own[i].value("part", "") == "test";
  }
  const auto assessed = [&](const std::string& run) {
    return dir.json("evaluate m " + run)["records"];
  };
  CHECK(assessed("a") == held_out);
  // All records of run b are copies of records of run a. The model was trained on run a.
  const nlohmann::json fresh = rows("b --model m");
  std::size_t test = 0;
  for (const auto& row : fresh) {
    test += row.value("part", "") == "test";
    CHECK((row.contains("part") || row["left_out"] == "trained on"));
  }
  CHECK(assessed("b") == test);
  const nlohmann::json blocked = rows("a --split blocked --set gap=2");
  CHECK(blocked[59]["part"] == "test");
  CHECK(std::ranges::count(blocked, "in the gap between the parts of the split",
                           [](const auto& row) { return row.value("left_out", ""); }) == 4);
  CHECK(dir.recon("rows --seed 2 a --model m").code == 2);
}

TEST_CASE("train and evaluate print the number of excluded records and the reasons") {
  const ReconFolder dir;
  const auto doubtful = [](FusedRecord& r) {
    if (r.index < 8) set_verdict(r, Sensor::depth, "stands still: the same as before");
    // The object is moved sideways, so that these maps are not copies of other maps.
    if (r.index < 8) std::ranges::rotate(depth_mm(r), depth_mm(r).begin() + 12);
    if (r.index == 8) set_verdict(r, Sensor::spd, "weak: 12 clicks above the background");
    if (r.index == 9) std::ranges::fill(counts(r), 0u);
    if (r.index == 10) counts(r)[5] = 4'294'967'295u;
    if (r.index == 11) r.valid.erase(Sensor::radar);
  };
  a_run(60, 1, doubtful).write(dir / "run");
  const std::string train = "train --model ridge --set fallback=false run --out ";
  CHECK_THAT(dir.done(train + "m"),
             Catch::Contains("12 of 60 records left out: SPD weak 1, camera stands still 8, "
                             "damaged 1, radar missing 1, the same in every bin 1 (") &&
                 Catch::Contains("record 10: spd bin 5 contains 4294967295 clicks"));
  CHECK_THAT(dir.done(train + "all --set doubtful=take"),
             Catch::Contains("3 of 60 records left out: damaged 1, radar missing 1, "));
  a_run(30, 2, [&](FusedRecord& r) {
    if (r.index < 8) doubtful(r);
  }).write(dir / "fresh");
  CHECK_THAT(dir.done("evaluate -q m fresh"),
             Catch::StartsWith("22 records; ") &&
                 Catch::Contains(
                     "doubtful records left out: camera stands still 8; including them: IoU 0."));
  a_run(4, 2, doubtful).write(dir / "frozen");
  for (const std::string command : {"evaluate -q m frozen", "train -q frozen --out no"})
    dir.refuses(command, 1, "frozen: 4 of 4 records left out: camera stands still 4");
}

TEST_CASE("copies of a record are used once in training and are excluded from evaluation") {
  const ReconFolder dir;
  a_run(60).write(dir / "a"), a_run(20).write(dir / "b"), a_run(20, 2).write(dir / "c");
  a_run(70).write(dir / "more");
  const std::string train = "train --model ridge --set fallback=false --set test_share=0 ";
  CHECK_THAT(dir.recon(train + "a b c --out abc").text,
             Catch::Contains("20 of 100 records left out: also in a 20\n"));
  dir.done(train + "a --out m");
  const std::string evaluate = "evaluate -q m ";
  dir.refuses(evaluate + "b", 1, "all records of this run are copies of training records");
  CHECK_THAT(
      dir.recon(evaluate + "more").text,
      Catch::StartsWith("10 records; ") &&
          Catch::Contains("60 of 70 records are copies of training records and are left out\n"));
  // The records of run d are nearly identical to those of run c. The nearest neighbour of an
  // evaluated record must not be its own copy.
  a_run(40, 2, [](FusedRecord& r) { power(r)[20] += 0.01f; }).write(dir / "d");
  const auto nearest = [&](const std::string& neighbours) {
    return dir.json(evaluate + "c --train " + neighbours)["trivial"]["nearest"]["iou"]["mean"]
        .get<double>();
  };
  CHECK(nearest("d") < 0.9);
  CHECK_THAT(dir.recon(evaluate + "more --all").text,
             Catch::StartsWith("70 records; ") &&
                 Catch::Contains("copies of training records and are scored\n"));
}

TEST_CASE(
    "a record with identical photon counts is recognised as a copy even if other data differ") {
  const ReconFolder dir;
  a_run(60).write(dir / "a");
  const std::string model = dir / "m";
  dir.done("train -q --model ridge --set fallback=false --set test_share=0 a --out " + model);
  const auto change = [](const std::string& how, FusedRecord& r) {
    if (how == "scaled")
      for (float& power : power(r)) power *= 2;
    if (how == "tripled")
      for (std::uint32_t& count : counts(r)) count *= 3;
    if (how == "dropped") r.valid.erase(Sensor::radar), power(r).clear();
    if (how == "label") r.label = "other";
    if (how == "one more") ++counts(r)[0];
    if (how == "doubled, one less") {
      for (std::uint32_t& count : counts(r)) count *= 2;
      --*std::ranges::max_element(counts(r));
    }
    if (how == "shifted") counts(r).insert(counts(r).begin(), 0), counts(r).pop_back();
  };
  const Dataset a = load({dir / "a"});
  Copies originals;
  for (std::size_t row = 0; row < 60; ++row)
    CHECK(originals.first(a.records[row].content, row) == row);
  for (const std::string how :
       {"scaled", "tripled", "dropped", "label", "one more", "doubled, one less", "shifted"}) {
    CAPTURE(how);
    a_run(60, 1, [&](FusedRecord& r) { change(how, r); }).write(dir / how);
    const Dataset copies = load({dir / how});
    int found = 0;
    for (std::size_t row = 0; row < 60; ++row)
      found += originals.first(copies.records[row].content, 99) == row;
    // The shift drops the last bin, which belongs to the fingerprints of a few narrow returns.
    CHECK(found >= (how == "shifted" ? 54 : 60));
  }
  dir.refuses("evaluate -q " + model + " scaled", 1, "are copies of training records");
  Axis longer = spd_axis();
  longer.count += 4;
  a_run(60, 1, [](FusedRecord& r) { std::fill_n(counts(r).end() - 4, 4, 0u); })
      .spd(longer)
      .write(dir / "padded");
  CHECK(values_of(load({dir / "padded"}), &RecordInfo::content) ==
        values_of(load({dir / "a"}), &RecordInfo::content));
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

TEST_CASE(
    "records that have few clicks or bins, or weak or frozen counts, are not treated as copies") {
  const Folder dir;
  a_run(9, 1, [](FusedRecord& r) {
    if (r.index < 2) {
      std::ranges::fill(counts(r), 0u);
      counts(r)[3] = 99;
    }
    if (r.index == 2 || r.index == 3)
      set_verdict(r, Sensor::spd, r.index == 2 ? "weak: 40 clicks" : "stands still: the same");
    // The peak of record 4 covers only three bins. The same peak may occur again by chance, so
    // no content hash is computed for the record.
    if (r.index == 4) {
      std::ranges::fill(counts(r), 0u);
      counts(r)[7] = counts(r)[9] = 4, counts(r)[8] = 300;
    }
    // Record 5 has only 99 clicks above a bright background, which is too few for a content
    // hash.
    if (r.index == 5) {
      std::ranges::fill(counts(r), 1000u);
      counts(r)[8] += 99;
    }
  }).write(dir / "run");
  const Dataset data = load({dir / "run"});
  for (std::size_t row = 0; row < 9; ++row) CHECK((data.records[row].content == 0) == (row < 6));
}

TEST_CASE("evaluate refuses a run with dead held-out records, and train refuses an empty run") {
  const ReconFolder dir;
  a_run(40).write(dir / "a");
  dir.done("train -q --model mean a --out m");
  dir.done("evaluate m a");
  damage(dir / "a", "histograms without counts in the records from ?1 to ?2", {0, 39});
  CHECK_THAT(dir.done("evaluate m a", 1), Catch::Contains("no valid held-out record is left"));
  damage(dir / "a", "without records");
  dir.refuses("train -q --model mean a --out n", 1, "contains no record to train on");
}

TEST_CASE("a record that occurs twice in a run is used once") {
  const ReconFolder dir;
  a_run(60, 1, [](FusedRecord& r) { show(r, r.index % 30, r.index % 30); }).write(dir / "twice");
  a_run(60, 2).write(dir / "a");
  const std::string train = "train --model ridge --set fallback=false ";
  CHECK_THAT(dir.recon(train + "twice --out no").text,
             Catch::Contains("30 of 60 records left out: twice in the run 30\n"));
  dir.done(train + "-q a --out m");
  CHECK_THAT(dir.recon("evaluate -q m twice").text,
             Catch::StartsWith("30 records; ") && Catch::Contains("twice in the run 30"));
}

TEST_CASE("train refuses a sensor that has no data and warns about a random split of a sequence") {
  const ReconFolder dir;
  const auto run = [&](const std::string& name, Sensor lost) {
    a_run(12, 1, [&](FusedRecord& r) { r.valid.erase(lost); }).write(dir / name);
    return "train " + name + " --out m";
  };
  dir.refuses(run("blind", Sensor::radar), 1, "no record has radar data; use --inputs spd");
  dir.refuses(run("dark", Sensor::spd), 1, "no record has SPD data; use --inputs radar");
  dir.refuses(run("without_maps", Sensor::depth), 1, "no record has a depth map");
  a_run(240, 1, [](FusedRecord& r) { show(r, r.index / 12, r.index); }).write(dir / "held");
  a_run(240).write(dir / "free");
  const auto says = [&](const std::string& name, const std::string& more) {
    std::filesystem::remove(dir / "m");
    return dir.recon("train --model mean --set fallback=false " + name + " --out m" + more).text;
  };
  CHECK_THAT(says("held", ""), Catch::Contains("consecutive records are alike") &&
                                   Catch::Contains("use --split blocked"));
  CHECK_THAT(says("held", " --split blocked"), !Catch::Contains("alike"));
  CHECK_THAT(says("free", ""), !Catch::Contains("alike"));
}

TEST_CASE("train reports repeated scenes for random and for blocked splits") {
  const ReconFolder dir;
  // The same scene is repeated after `scenes` records, but with different noise.
  const auto recurring = [](std::int64_t scenes) {
    return [scenes](FusedRecord& r) { show(r, r.index % scenes, r.index); };
  };
  a_run(240, 1, recurring(30)).write(dir / "recurring");
  a_run(240, 1, recurring(120)).write(dir / "pairs"), a_run(240).write(dir / "free");
  a_run(240, 1, [](FusedRecord& r) {
    if (r.index % 3) std::ranges::fill(depth_mm(r), std::uint16_t{0});
  }).write(dir / "empty");
  for (const std::string split : {"random", "blocked"}) {
    CAPTURE(split);
    const auto said = [&](const std::string& name) {
      std::filesystem::remove(dir / "m");
      return dir
          .recon("train --model mean --set fallback=false --split " + split + " " + name +
                 " --out m")
          .text;
    };
    CHECK_THAT(said("recurring"), Catch::Contains("scenes recur: 24 of 24 held-out depth maps") &&
                                      Catch::Contains("evaluate on a run of other scenes"));
    CHECK_THAT(said("pairs"), Catch::Contains("scenes recur: "));
    CHECK_THAT(said("free"), !Catch::Contains("scenes recur"));
    CHECK_THAT(said("empty"), !Catch::Contains("scenes recur"));
  }
}
