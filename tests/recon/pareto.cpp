// SPDX-License-Identifier: MIT
// The study of accuracy against cost.
#include <signal.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "../full_disk.hpp"
#include "drivers/chart/chart.hpp"
#include "recon/study/study.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

TEST_CASE("study pareto: a row a model and share, the front marked, a chart") {
  const Folder dir;
  write_run(dir / "train", 200);
  write_run(dir / "test", 40, 5);
  const Outcome o = recon_program(
      "study pareto " + (dir / "train") + " " + (dir / "test") + " -q --seeds 2 --out " +
      (dir / "out") + " --models empty,silhouette,nearest,mean:spd --sweep-models silhouette " +
      "--photons 0.1 --records 0.5");
  CAPTURE(o.text);
  REQUIRE(o.code == 0);
  std::ifstream csv(dir / "out/pareto.csv");
  std::string line, header;
  std::getline(csv, header);
  CHECK(header.starts_with("sweep,share,model,seeds,iou,iou_spread"));
  std::vector<std::string> begins, fronts;
  while (std::getline(csv, line)) {
    begins.push_back(line.substr(0, line.find(",2,")));
    if (line.substr(0, line.rfind(',')).ends_with(",1")) fronts.push_back(begins.back());
    CHECK(std::count(line.begin(), line.end(), ',') ==
          std::count(header.begin(), header.end(), ','));
  }
  CHECK(begins == std::vector<std::string>{"model,1,empty", "model,1,silhouette", "model,1,nearest",
                                           "model,1,mean:spd", "photons,0.1,silhouette",
                                           "records,0.5,silhouette"});
  CHECK(std::count(fronts.begin(), fronts.end(), "model,1,silhouette") == 1);
  CHECK(std::filesystem::file_size(dir / "out/pareto.svg") > 1000);
  CHECK(std::distance(std::filesystem::directory_iterator(dir / "out"), {}) == 3);  // .sqlite
  const Outcome same = recon_program("study pareto " + (dir / "train") + " " + (dir / "train") +
                                     " --out " + (dir / "same"));
  CHECK(same.code == 2);
  CHECK_THAT(same.text, Catch::Contains("the models are trained on this run"));
}

TEST_CASE("studies compare models of the radar's antennas with those of its profile") {
  const std::vector<std::string> models = {"nearest", "silhouette", "factorised-4",
                                           "factorised-4:fused-profile", "ridge:spd"};
  CHECK(with_profiles(models) ==
        std::vector<std::string>{"nearest", "silhouette", "silhouette:fused-profile",
                                 "factorised-4", "factorised-4:fused-profile", "ridge:spd"});
}

TEST_CASE("study pareto goes on where it stopped, and draws the bound") {
  const Folder dir;
  write_run(dir / "train", 200);
  write_run(dir / "test", 40, 5);
  const std::string file = dir / "out/study.sqlite";
  const auto study = [&](const std::string& models, const std::string& more = {},
                         const std::string& records = "0.5") {
    return recon_program("study pareto " + (dir / "train") + " " + (dir / "test") +
                         " -q --seeds 1 --out " + (dir / "out") + " --models " + models +
                         " --sweep-models silhouette --photons 0.1 --records " + records + more);
  };
  const auto table = [&] { return contents(dir / "out/pareto.csv"); };
  const Outcome stopped = study("empty,mean", {}, "1e-9");  // of one record nothing can be learnt
  CAPTURE(stopped.text);
  REQUIRE(stopped.code != 0);
  CHECK(table().empty());
  CHECK(sql(file, "SELECT DISTINCT axis || ' ' || model FROM measurement") ==
        "model empty\nmodel mean\nphotons silhouette\n");
  sql(file, "UPDATE measurement SET score = 0.0625 WHERE model = 'empty' AND metric = 'iou'");

  const Outcome more = study("empty,mean,silhouette", " --bound 0.0375,0.0125");
  CAPTURE(more.text);
  REQUIRE(more.code == 0);
  const std::string all = table();
  CHECK_THAT(all, Catch::Contains("\nmodel,1,empty,1,0.0625,"));
  CHECK_THAT(all, Catch::Contains("\nphotons,0.1,silhouette,1,"));
  CHECK(std::count(all.begin(), all.end(), '\n') == 1 + 5);
  CHECK_THAT(contents(dir / "out/pareto.svg"), Catch::Contains("least possible: 3.75 cm") &&
                                                   Catch::Contains("with known shape: 1.25 cm"));
  CHECK(study("empty", " --bound 0.0375").code == 2);
  CHECK(study("empty", " --bound 0.0375,0").code == 2);

  std::ofstream(dir / "out/pareto.csv") << "nobody reads this\n";
  CHECK(study("empty").code == 0);
  CHECK(table() == all);
}

TEST_CASE("study pareto keeps what is measured, and no row of a training that was broken off") {
  const Folder dir;
  write_run(dir / "train", 1000);
  write_run(dir / "test", 40, 5);
  for (const bool killed : {false, true}) {
    const std::string out = dir / (killed ? "killed" : "interrupted"), file = out + "/study.sqlite";
    const pid_t child =
        start_recon({"study", "pareto", dir / "train", dir / "test", "-q", "--seeds", "1",
                     "--models", "empty,mlp-1024-1024", "--out", out});
    const auto models = [&] { return sql(file, "SELECT DISTINCT model FROM measurement"); };
    while (kill(child, 0) == 0 && (contents(file).empty() || models() != "empty\n"))
      ::usleep(10'000);
    ::usleep(500'000);
    if (killed) {
      kill(child, SIGKILL);
      waitpid(child, nullptr, 0);
    } else {
      CHECK(interrupted_code(child) == 130);
    }
    CHECK(models() == "empty\n");
  }
}

TEST_CASE("study pareto refuses what it cannot judge or must not mix, before it trains") {
  const Folder dir;
  write_run(dir / "train", 60);
  write_run(dir / "test", 40, 5);
  write_run(dir / "third", 40, 6);
  write_run(dir / "blind", 40, 6, [](record::FusedRecord& r) {
    r.valid.erase(Sensor::depth);
    r.depth_mm.clear();
  });
  const auto study = [&](const std::string& run) {
    return recon_program("study pareto " + (dir / "train") + " " + (dir / run) +
                         " -q --seeds 1 --models mean --photons 1 --records 1 --sweep-models mean" +
                         " --out " + (dir / "out"));
  };
  const Outcome blind = study("blind");
  CHECK(blind.code == 1);
  CHECK_THAT(blind.text, Catch::Contains("no record has depth and the live sensors"));
  CHECK_FALSE(std::filesystem::exists(dir / "out"));
  REQUIRE(study("test").code == 0);
  const std::string file = dir / "out/study.sqlite", table = contents(dir / "out/pareto.csv");
  const Outcome other = study("third");
  CHECK(other.code == 2);
  CHECK_THAT(other.text, Catch::Contains("study.sqlite: was measured with test ") &&
                             Catch::Contains(" (now: ") &&
                             Catch::Contains("give the same settings, or another folder"));
  CHECK_THAT(other.text, !Catch::Contains("train "));
  sql(file, "UPDATE setting SET value = char(27) || '0' WHERE key = 'echofuse'");
  const Outcome older = study("test");
  CHECK(older.code == 2);
  CHECK_THAT(older.text, Catch::Contains("measured with echofuse \\x1b0 (now: "));
  std::filesystem::remove(file);
  const Outcome unknown = study("test");
  CHECK(unknown.code == 2);
  CHECK_THAT(unknown.text, Catch::Contains("study.sqlite is missing"));
  CHECK(contents(dir / "out/pareto.csv") == table);
  CHECK_FALSE(std::filesystem::exists(file));
}

TEST_CASE("nothing of a study file is believed") {
  const Folder dir;
  write_run(dir / "train", 60);
  write_run(dir / "test", 40, 5);
  const std::string file = dir / "out/study.sqlite";
  const auto study = [&] {
    return recon_program("study pareto " + (dir / "train") + " " + (dir / "test") +
                         " -q --seeds 1 --models mean --photons 1 --records 1 --sweep-models mean" +
                         " --out " + (dir / "out"));
  };
  REQUIRE(study().code == 0);
  const std::string sound = contents(file);
  const auto refused = [&](const std::string& change, int code, const std::string& text) {
    std::ofstream(file, std::ios::binary) << sound;
    sql(file, change);
    const Outcome o = study();
    CAPTURE(change, o.text);
    CHECK(o.code == code);
    CHECK_THAT(o.text, Catch::Contains("study.sqlite: ") && Catch::Contains(text));
    CHECK(std::count(o.text.begin(), o.text.end(), '\n') == 1);
  };
  refused("CREATE TRIGGER t AFTER INSERT ON measurement BEGIN DELETE FROM setting; END", 3,
          "holds the trigger \"t\"; expected the tables of a study only");
  refused("CREATE VIEW v AS SELECT 1", 3, "holds the view \"v\"");
  refused("CREATE TABLE more (a)", 3, "holds the table \"more\"");
  refused("ALTER TABLE measurement ADD COLUMN \"\x1b[2J\"", 3, "has the column \"\\x1b[2J\"");
  refused("ALTER TABLE measurement DROP COLUMN score", 3, "no such column: score");
  refused("DROP TABLE measurement", 3, "not the expected tables");
  refused("PRAGMA application_id = 7", 3, "is not the file of a study");
  refused("UPDATE measurement SET model = 'mean'';reboot'", 1, "\"mean';reboot\" is no name");
  refused("UPDATE measurement SET axis = 'a' || char(10) WHERE rowid = 1", 1,
          "\"a\\n\" is no name");
  refused("UPDATE measurement SET metric = '' WHERE rowid = 1", 1, "is no name");
  std::ofstream(file, std::ios::binary) << sound.substr(0, sound.size() / 2);
  const Outcome cut = study();
  CHECK(cut.code == 1);
  CHECK_THAT(cut.text, Catch::Contains("study.sqlite: ") && Catch::Contains("malformed"));
  std::ofstream(file, std::ios::binary)
      << sound.substr(0, sound.size() - 4096) << std::string(4096, 'x');
  const Outcome page = study();
  CHECK(page.code == 1);
  CHECK_THAT(page.text, Catch::Contains("study.sqlite: damaged: "));
  std::ofstream(file, std::ios::binary) << "sweep,share\nmodel,1\n";
  const Outcome text = study();
  CHECK(text.code == 3);
  CHECK_THAT(text.text, Catch::Contains("file is not a database"));
  std::ofstream(file, std::ios::binary) << "";  // killed as it began
  CHECK(study().code == 0);
}

TEST_CASE("a chart that cannot be written leaves the table that was there") {
  const Folder dir;
  std::ofstream(dir / "x.csv") << "all of it\n";
  {
    const test::FullDisk disk(2);
    CHECK_THROWS_AS(chart::write_chart(dir.path.string(), "x", "new\n", "<svg/>"), Error);
  }
  CHECK(contents(dir / "x.csv") == "all of it\n");
}
