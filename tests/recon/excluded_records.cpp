// SPDX-License-Identifier: MIT
// Tests which records are excluded from training and evaluation: damaged, dead, doubtful and
// duplicate records.
#include <limits>
#include <nlohmann/json.hpp>

#include "recon/data/dataset.hpp"
#include "recon/train/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

TEST_CASE("damaged records are counted, and a run with more than 10 % damaged records is refused") {
  const Folder dir;
  const auto spoil = [&](const std::string& name, std::int64_t from) {
    write_run(dir / name, 20, 1, [&](record::FusedRecord& r) {
      r.slot_end = r.slot_start + std::chrono::seconds(3);
      if (r.index >= from) r.radar[3] = std::numeric_limits<float>::quiet_NaN();
      if (r.index == 4) r.spd[7] = 4'294'967'295u;
    });
  };
  spoil("a", 19);
  const Dataset data = load({dir / "a"});
  CHECK(data.size() == 18);
  REQUIRE(data.damaged.size() == 2);
  CHECK_THAT(to_text(data.damaged.front()),
             Catch::Contains("record 4: spd bin 7 contains 4294967295 clicks, more than"));
  spoil("b", 18);
  CHECK_THAT(
      error_of([&] { load({dir / "b"}); }),
      Catch::Contains("record 4: ") && Catch::Contains("3 of 20 records are dead or damaged"));
  std::vector<std::int64_t> bad;
  load_part(record::RunReader(dir / "a"), 0, 20, sensors_of(Inputs::fused),
            [&](std::int64_t index, const std::string&) { bad.push_back(index); });
  CHECK(bad == std::vector<std::int64_t>{4, 19});
  // In a slot of 3 s, more than 300 million clicks exceed the limit of 100 million clicks per
  // second.
  write_run(dir / "c", 20, 1, [](record::FusedRecord& r) {
    r.slot_end = r.slot_start + std::chrono::seconds(3);
    if (r.index == 4) r.spd[7] = 300'000'001;
  });
  CHECK(load({dir / "c"}).damaged.size() == 1);
}

TEST_CASE("dead and damaged records count together for the limit of 10 %") {
  const Folder dir;
  const auto error_with = [&](std::int64_t damaged, std::int64_t dead) {
    write_run(dir / "a", 50, 1, [&](record::FusedRecord& r) {
      if (r.index < damaged) r.radar[3] = std::numeric_limits<float>::quiet_NaN();
      if (r.index >= 50 - dead) std::ranges::fill(r.spd, 0u);
    });
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
  write_run(dir / "a", 8, 1, [](record::FusedRecord& r) {
    if (r.index == 1) r.sync[Sensor::depth].verdict = "stands still: the same as before";
    if (r.index == 2) r.sync[Sensor::radar].verdict = "weak: the echo is 0.05 of the usual";
    if (r.index == 3) r.sync[Sensor::spd].verdict = "no peak: no bins clearly exceed the mean";
    if (r.index == 4) r.sync[Sensor::spd].verdict = "saturated: 0.2 clicks per laser pulse";
  });
  const Dataset data = load({dir / "a"});
  CHECK(data.doubt_of(0, Inputs::fused).empty());
  CHECK(data.doubt_of(1, Inputs::fused) == "camera frozen");
  CHECK(data.doubt_of(2, Inputs::fused) == "radar weak");
  CHECK(data.doubt_of(2, Inputs::spd).empty());
  CHECK(data.doubt_of(4, Inputs::spd) == "SPD saturated");
  CHECK(data.usable(Inputs::fused) == Rows{0, 3, 5, 6, 7});
}

TEST_CASE("records with lost frames are counted, and are used unless a setting excludes them") {
  const Folder dir;
  write_run(dir / "a", 40, 1, [](record::FusedRecord& r) {
    if (r.index == 1)
      r.sync[Sensor::depth].verdict = "lossy: 50 % of the 90 expected frames received";
    if (r.index == 2)
      r.sync[Sensor::radar].verdict = "lossy: 50 % of the 60 expected frames received";
    if (r.index == 3) r.sync[Sensor::spd].verdict = "weak: 12 clicks above the background";
  });
  Dataset data = load({dir / "a"});
  CHECK(data.usable(Inputs::fused).size() == 39);
  const std::string train = "train --model mean " + (dir / "a") + " --out ";
  CHECK_THAT(recon_program(train + (dir / "m")).text,
             Catch::Contains("2 lossy records are used; --set lossy=leave excludes them"));
  CHECK_THAT(
      recon_program(train + (dir / "n") + " --set lossy=leave").text,
      Catch::Contains("3 of 40 records left out: SPD weak 1, camera lossy 1, radar lossy 1"));
  data.leave_lossy = true;
  CHECK(data.usable(Inputs::spd).size() == 38);
}

TEST_CASE("a copied record has the same content hash in every run") {
  const Folder dir;
  write_run(dir / "a", 6, 1), write_run(dir / "b", 3, 1), write_run(dir / "c", 3, 2);
  const Dataset a = load({dir / "a"});
  const Dataset b = load({dir / "b"}), c = load({dir / "c"});
  CHECK(b.content == std::vector<std::int64_t>(a.content.begin(), a.content.begin() + 3));
  CHECK(c.content != b.content);
}

TEST_CASE("the rows command prints the split part of each record or the reason for its exclusion") {
  const Folder dir;
  const auto change = [](record::FusedRecord& r) {
    if (r.index == 2) r.sync[Sensor::depth].verdict = "stands still: the same as before";
    if (r.index == 3) r.valid.erase(Sensor::radar);
    if (r.index == 4) r.radar[3] = std::numeric_limits<float>::quiet_NaN();
    if (r.index == 5) std::ranges::fill(r.spd, 7u);
  };
  write_run(dir / "a", 60, 1, change), write_run(dir / "b", 8, 1);
  const auto rows = [&](const std::string& words) {
    const Outcome o = recon_program("-q rows --json " + words);
    CAPTURE(o.text);
    REQUIRE(o.code == 0);
    return nlohmann::json::parse(o.text)["records"];
  };
  const nlohmann::json both = rows((dir / "a ") + (dir / "b"));
  REQUIRE(both.size() == 68);
  const auto why = [&](std::size_t i) { return both[i].value("left_out", ""); };
  CHECK(why(2) == "camera frozen");
  CHECK(why(3) == "radar missing");
  CHECK(why(4) == "damaged");
  CHECK(why(5) == "the same in every bin");
  CHECK(why(60) == "also in " + (dir / "a"));
  CHECK(both[67]["run"] == dir / "b");
  REQUIRE(recon_program("train -q --model mean --seed 3 " + (dir / "a") + " --out " + (dir / "m"))
              .code == 0);
  // The model was also trained with the split seed 3, so both splits must agree.
  const nlohmann::json split = rows((dir / "a") + " --seed 3");
  const nlohmann::json own = rows((dir / "a") + " --model " + (dir / "m"));
  std::size_t held_out = 0;
  for (std::size_t i = 0; i < split.size(); ++i) {
    CHECK(split[i].value("part", "") == own[i].value("part", ""));
    held_out += own[i].value("part", "") == "test";
  }
  const auto judged = [&](const std::string& run) {
    return nlohmann::json::parse(
        recon_program("-q evaluate --json " + (dir / "m ") + run).text)["records"];
  };
  CHECK(judged(dir / "a") == held_out);
  // All records of run b are copies of records of run a. The model was trained on run a.
  const nlohmann::json fresh = rows((dir / "b") + " --model " + (dir / "m"));
  std::size_t test = 0;
  for (const auto& row : fresh) {
    test += row.value("part", "") == "test";
    CHECK((row.contains("part") || row["left_out"] == "trained on"));
  }
  CHECK(judged(dir / "b") == test);
  const nlohmann::json blocked = rows((dir / "a") + " --split blocked --set gap=2");
  CHECK(blocked[59]["part"] == "test");
  CHECK(std::ranges::count(blocked, "in the gap between the parts of the split",
                           [](const auto& row) { return row.value("left_out", ""); }) == 4);
  CHECK(recon_program("rows --seed 2 " + (dir / "a") + " --model " + (dir / "m")).code == 2);
}

TEST_CASE("train and evaluate print the number of excluded records and the reasons") {
  const Folder dir;
  const auto doubtful = [](record::FusedRecord& r) {
    if (r.index < 8)
      r.sync[Sensor::depth].verdict =
          "stands still: identical to the previous record in every pixel";
    // The object is moved sideways, so that these maps are not copies of other maps.
    if (r.index < 8) std::ranges::rotate(r.depth_mm, r.depth_mm.begin() + 12);
    if (r.index == 8) r.sync[Sensor::spd].verdict = "weak: 12 clicks above the background";
    if (r.index == 9) std::ranges::fill(r.spd, 0u);
    if (r.index == 10) r.spd[5] = 4'294'967'295u;
    if (r.index == 11) r.valid.erase(Sensor::radar);
  };
  write_run(dir / "run", 60, 1, doubtful);
  const std::string train = "train --model ridge --set fallback=false " + (dir / "run") + " --out ";
  const Outcome left = recon_program(train + (dir / "m"));
  CHECK(left.code == 0);
  CHECK_THAT(left.text, Catch::Contains("12 of 60 records left out: SPD weak 1, camera frozen 8, "
                                        "damaged 1, radar missing 1, the same in every bin 1 (") &&
                            Catch::Contains("record 10: spd bin 5 contains 4294967295 clicks"));
  const Outcome taken = recon_program(train + (dir / "all") + " --set doubtful=take");
  CHECK_THAT(taken.text, Catch::Contains("3 of 60 records left out: damaged 1, radar missing 1, "));
  write_run(dir / "fresh", 30, 2, [&](record::FusedRecord& r) {
    if (r.index < 8) doubtful(r);
  });
  const Outcome judged = recon_program("evaluate -q " + (dir / "m") + " " + (dir / "fresh"));
  CHECK_THAT(judged.text,
             Catch::StartsWith("22 records; ") &&
                 Catch::Contains("doubtful records left out: camera frozen 8; including them: "
                                 "IoU 0."));
  write_run(dir / "frozen", 4, 2, doubtful);
  refuses("evaluate -q " + (dir / "m") + " " + (dir / "frozen"), 1,
          (dir / "frozen") + ": 4 of 4 records left out: camera frozen 4");
  refuses("train -q " + (dir / "frozen") + " --out " + (dir / "no"), 1,
          (dir / "frozen") + ": 4 of 4 records left out: camera frozen 4");
  write_run(dir / "dead", 60, 1, [](record::FusedRecord& r) {
    if (r.index % 8 == 3) std::ranges::fill(r.radar, 1.f);
  });
  refuses("train -q " + (dir / "dead") + " --out " + (dir / "no"), 1,
          "record 3: radar is the same in every bin; the sensor is dead, or the room is empty and "
          "dark; 8 of 60 records");
}

TEST_CASE("copies of a record are used once in training and are excluded from evaluation") {
  const Folder dir;
  write_run(dir / "a", 60, 1), write_run(dir / "b", 20, 1), write_run(dir / "c", 20, 2);
  write_run(dir / "more", 70, 1);
  const std::string train = "train --model ridge --set fallback=false --set test_share=0 ";
  CHECK_THAT(recon_program(train + (dir / "a") + " " + (dir / "b") + " " + (dir / "c") + " --out " +
                           (dir / "abc"))
                 .text,
             Catch::Contains("20 of 100 records left out: also in " + (dir / "a") + " 20\n"));
  REQUIRE(recon_program(train + (dir / "a") + " --out " + (dir / "m")).code == 0);
  const std::string evaluate = "evaluate -q " + (dir / "m") + " ";
  refuses(evaluate + (dir / "b"), 1, "all records of this run are copies of training records");
  CHECK_THAT(
      recon_program(evaluate + (dir / "more")).text,
      Catch::StartsWith("10 records; ") &&
          Catch::Contains("60 of 70 records are copies of training records and are left out\n"));
  // The records of run d are nearly identical to those of run c. The nearest neighbour of an
  // evaluated record must not be its own copy.
  write_run(dir / "d", 40, 2, [](record::FusedRecord& r) { r.radar[20] += 0.01f; });
  const auto nearest = [&](const std::string& neighbours) {
    return nlohmann::json::parse(
               recon_program(evaluate + "--json " + (dir / "c") + " --train " + (dir / neighbours))
                   .text)["trivial"]["nearest"]["iou"]["mean"]
        .get<double>();
  };
  CHECK(nearest("d") < 0.9);
  CHECK_THAT(recon_program(evaluate + (dir / "more") + " --all").text,
             Catch::StartsWith("70 records; ") &&
                 Catch::Contains("copies of training records and are scored\n"));
}

TEST_CASE(
    "a record with identical photon counts is recognised as a copy even if other data differ") {
  const Folder dir;
  write_run(dir / "a", 60, 1);
  const std::string model = dir / "m";
  REQUIRE(recon_program("train -q --model ridge --set fallback=false --set test_share=0 " +
                        (dir / "a") + " --out " + model)
              .code == 0);
  const auto change = [](const std::string& how, record::FusedRecord& r) {
    if (how == "scaled")
      for (float& power : r.radar) power *= 2;
    if (how == "dropped") r.valid.erase(Sensor::radar), r.radar.clear();
    if (how == "label") r.label = "other";
  };
  for (const std::string how : {"scaled", "dropped", "label"}) {
    CAPTURE(how);
    write_run(dir / how, 60, 1, [&](record::FusedRecord& r) { change(how, r); });
    CHECK(load({dir / how}).content == load({dir / "a"}).content);
  }
  refuses("evaluate -q " + model + " " + (dir / "scaled"), 1, "are copies of training records");
  Axis longer = testing::spd_axis();
  longer.count += 4;
  write_run(
      dir / "padded", 60, 1, [](record::FusedRecord& r) { std::fill_n(r.spd.end() - 4, 4, 0u); },
      testing::radar_axis(), longer);
  CHECK(load({dir / "padded"}).content == load({dir / "a"}).content);
}

TEST_CASE(
    "records that have few clicks or bins, or weak or frozen counts, are not treated as copies") {
  const Folder dir;
  write_run(dir / "run", 9, 1, [](record::FusedRecord& r) {
    if (r.index < 2) {
      std::ranges::fill(r.spd, 0u);
      r.spd[3] = 99;
    }
    if (r.index == 2 || r.index == 3)
      r.sync[Sensor::spd].verdict = r.index == 2 ? "weak: 40 clicks" : "stands still: the same";
    // The peak of record 4 covers only three bins. The same peak may occur again by chance, so no
    // content hash is computed for the record.
    if (r.index == 4) {
      std::ranges::fill(r.spd, 0u);
      r.spd[7] = r.spd[9] = 4, r.spd[8] = 300;
    }
    // Record 5 has only 99 clicks above a bright background, which is too few for a content hash.
    if (r.index == 5) {
      std::ranges::fill(r.spd, 1000u);
      r.spd[8] += 99;
    }
  });
  const Dataset data = load({dir / "run"});
  for (std::size_t row = 0; row < 9; ++row) CHECK((data.content[row] == 0) == (row < 6));
}

TEST_CASE("evaluate refuses a run with dead held-out records, and train refuses an empty run") {
  const Folder dir;
  write_run(dir / "a", 40);
  REQUIRE(recon_program("train -q --model mean " + (dir / "a") + " --out " + (dir / "m")).code ==
          0);
  REQUIRE(recon_program("evaluate " + (dir / "m") + " " + (dir / "a")).code == 0);
  sql(dir / "a", "UPDATE record SET spd = zeroblob(length(spd))");
  const Outcome dead = recon_program("evaluate " + (dir / "m") + " " + (dir / "a"));
  CAPTURE(dead.text);
  CHECK(dead.code == 1);
  CHECK_THAT(dead.text, Catch::Contains("no valid held-out record is left"));
  sql(dir / "a", "DELETE FROM record");
  const Outcome none =
      recon_program("train -q --model mean " + (dir / "a") + " --out " + (dir / "n"));
  CHECK(none.code == 1);
  CHECK_THAT(none.text, Catch::Contains("contains no record to train on"));
}

TEST_CASE("a record that occurs twice in a run is used once") {
  const Folder dir;
  const auto twice = [](record::FusedRecord& r) {
    Rng rng = make_rng(3, static_cast<std::uint64_t>(r.index % 30));
    std::uniform_real_distribution<double> x(-1, 1), z(3, 4);
    const double at_x = x(rng), at_z = z(rng);
    r = testing::plate_record(r.index, at_x, at_z, rng);
  };
  write_run(dir / "twice", 60, 1, twice), write_run(dir / "a", 60, 2);
  const std::string train = "train --model ridge --set fallback=false ";
  CHECK_THAT(recon_program(train + (dir / "twice") + " --out " + (dir / "no")).text,
             Catch::Contains("30 of 60 records left out: twice in the run 30\n"));
  REQUIRE(recon_program(train + "-q " + (dir / "a") + " --out " + (dir / "m")).code == 0);
  CHECK_THAT(recon_program("evaluate -q " + (dir / "m") + " " + (dir / "twice")).text,
             Catch::StartsWith("30 records; ") && Catch::Contains("twice in the run 30"));
}

TEST_CASE("train refuses a sensor that has no data and warns about a random split of a sequence") {
  const Folder dir;
  const auto run = [&](const std::string& name, Sensor lost) {
    write_run(dir / name, 12, 1, [&](record::FusedRecord& r) { r.valid.erase(lost); });
    return "train " + (dir / name) + " --out " + (dir / "m");
  };
  refuses(run("blind", Sensor::radar), 1, "no record has radar data; use --inputs spd");
  refuses(run("dark", Sensor::spd), 1, "no record has SPD data; use --inputs radar");
  refuses(run("without_maps", Sensor::depth), 1, "no record has a depth map");
  const auto held = [](record::FusedRecord& r) {
    Rng rng = make_rng(1, static_cast<std::uint64_t>(r.index) / 12);
    std::uniform_real_distribution<double> x(-1, 1), z(3, 4);
    const double at_x = x(rng), at_z = z(rng);
    Rng of_record = make_rng(2, static_cast<std::uint64_t>(r.index));
    r = testing::plate_record(r.index, at_x, at_z, of_record);
  };
  write_run(dir / "held", 240, 1, held), write_run(dir / "free", 240, 1);
  const auto says = [&](const std::string& name, const std::string& more) {
    std::filesystem::remove(dir / "m");
    return recon_program("train --model mean --set fallback=false " + (dir / name) + " --out " +
                         (dir / "m") + more)
        .text;
  };
  CHECK_THAT(says("held", ""), Catch::Contains("consecutive records are alike") &&
                                   Catch::Contains("use --split blocked"));
  CHECK_THAT(says("held", " --split blocked"), !Catch::Contains("alike"));
  CHECK_THAT(says("free", ""), !Catch::Contains("alike"));
}

TEST_CASE("train reports repeated scenes for random and for blocked splits") {
  const Folder dir;
  // The same scene is repeated after `scenes` records, but with different noise.
  const auto recurring = [](std::int64_t scenes) {
    return [scenes](record::FusedRecord& r) {
      Rng rng = make_rng(1, static_cast<std::uint64_t>(r.index % scenes));
      std::uniform_real_distribution<double> x(-1, 1), z(3, 4);
      const double at_x = x(rng), at_z = z(rng);
      Rng of_record = make_rng(2, static_cast<std::uint64_t>(r.index));
      std::normal_distribution<double> noise_m(0, 0.003);
      r = testing::plate_record(r.index, at_x, at_z + noise_m(of_record), of_record);
    };
  };
  write_run(dir / "recurring", 240, 1, recurring(30));
  write_run(dir / "pairs", 240, 1, recurring(120)), write_run(dir / "free", 240, 1);
  write_run(dir / "empty", 240, 1, [](record::FusedRecord& r) {
    if (r.index % 3) std::ranges::fill(r.depth_mm, std::uint16_t{0});
  });
  for (const std::string split : {"random", "blocked"}) {
    CAPTURE(split);
    const auto said = [&](const std::string& name) {
      std::filesystem::remove(dir / "m");
      return recon_program("train --model mean --set fallback=false --split " + split + " " +
                           (dir / name) + " --out " + (dir / "m"))
          .text;
    };
    CHECK_THAT(said("recurring"), Catch::Contains("scenes recur: 24 of 24 held-out depth maps") &&
                                      Catch::Contains("evaluate on a run of other scenes"));
    CHECK_THAT(said("pairs"), Catch::Contains("scenes recur: "));
    CHECK_THAT(said("free"), !Catch::Contains("scenes recur"));
    CHECK_THAT(said("empty"), !Catch::Contains("scenes recur"));
  }
}
