// SPDX-License-Identifier: MIT
// The study of accuracy against cost.
#include <signal.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "drivers/chart/gnuplot.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {}  // namespace

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
    if (line.ends_with(",1")) fronts.push_back(begins.back());
    CHECK(std::count(line.begin(), line.end(), ',') ==
          std::count(header.begin(), header.end(), ','));
  }
  CHECK(begins == std::vector<std::string>{"model,1,empty", "model,1,silhouette", "model,1,nearest",
                                           "model,1,mean:spd", "photons,0.1,silhouette",
                                           "records,0.5,silhouette"});
  CHECK(std::count(fronts.begin(), fronts.end(), "model,1,silhouette") == 1);
  CHECK(std::filesystem::file_size(dir / "out/pareto.svg") > 1000);
  CHECK(std::distance(std::filesystem::directory_iterator(dir / "out"), {}) == 4);  // .runs, .gp
  const Outcome same = recon_program("study pareto " + (dir / "train") + " " + (dir / "train") +
                                     " --out " + (dir / "same"));
  CHECK(same.code == 2);
  CHECK_THAT(same.text, Catch::Contains("the models are trained on this run"));
}

TEST_CASE("study pareto goes on where it stopped, and draws the bound") {
  const Folder dir;
  write_run(dir / "train", 200);
  write_run(dir / "test", 40, 5);
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
  CHECK_THAT(table(), Catch::Contains("\nmodel,1,mean,1,"));
  std::string marked = table();
  const std::string there = "\nmodel,1,empty,1,0,";
  REQUIRE(marked.find(there) != std::string::npos);
  marked.replace(marked.find(there), there.size(), "\nmodel,1,empty,1,0.0625,");
  std::ofstream(dir / "out/pareto.csv") << marked;

  std::ofstream(dir / "bound.csv") << "axis,value,known,lateral_error_m\nbase,0,shape,0.0125\n"
                                      "base,0,pose,0.0375\nphotons,100,pose,0.5\n";
  const Outcome more = study("empty,mean,silhouette", " --bound " + (dir / "bound.csv"));
  CAPTURE(more.text);
  REQUIRE(more.code == 0);
  const std::string all = table();
  CHECK_THAT(all, Catch::Contains("\nmodel,1,empty,1,0.0625,"));
  CHECK_THAT(all, Catch::Contains("\nphotons,0.1,silhouette,1,"));
  CHECK(std::count(all.begin(), all.end(), '\n') == 1 + 5);
  CHECK_THAT(contents(dir / "out/pareto.gp"),
             Catch::Contains("0.0375 with lines") && Catch::Contains("0.0125 with lines"));
  CHECK_THAT(contents(dir / "out/pareto.svg"), Catch::Contains("bound: pose unknown"));

  const Outcome nowhere = study("empty", " --bound " + (dir / "nowhere.csv"));
  CHECK(nowhere.code == 1);
  CHECK_THAT(nowhere.text, Catch::Contains("nowhere.csv: No such file"));
  const Outcome no_bound = study("empty", " --bound " + (dir / "out/pareto.csv"));
  CHECK(no_bound.code == 1);
  CHECK_THAT(no_bound.text, Catch::Contains("is not a bound.csv"));
  write_run(dir / "third", 40, 6);
  const Outcome other = recon_program("study pareto " + (dir / "train") + " " + (dir / "third") +
                                      " -q --out " + (dir / "out"));
  CHECK(other.code == 2);
  CHECK_THAT(other.text, Catch::Contains("a study of other runs"));
  std::ofstream(dir / "out/pareto.csv") << "sweep,share\nmodel,1\n";
  CHECK_THAT(study("empty").text, Catch::Contains("pareto.csv: expected a number as seeds"));
}

TEST_CASE("study pareto keeps no row of a training that was broken off") {
  const Folder dir;
  write_run(dir / "train", 1000);
  write_run(dir / "test", 40, 5);
  const std::string out = dir / "out";
  const pid_t child = start_recon({"study", "pareto", dir / "train", dir / "test", "-q", "--seeds",
                                   "1", "--models", "empty,mlp-1024-1024", "--out", out});
  while (contents(out + "/pareto.csv").find("model,1,empty,") == std::string::npos &&
         kill(child, 0) == 0)
    ::usleep(10'000);
  ::usleep(500'000);
  CHECK(interrupted_code(child) == 130);
  CHECK_THAT(contents(out + "/pareto.csv"), !Catch::Contains("mlp-1024-1024"));
}

TEST_CASE("study pareto refuses what it cannot judge or must not mix, before it trains") {
  const Folder dir;
  write_run(dir / "train", 60);
  write_run(dir / "test", 40, 5);
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
  CHECK(std::filesystem::is_empty(dir / "out"));
  REQUIRE(study("test").code == 0);
  const std::string runs = contents(dir / "out/pareto.runs"),
                    table = contents(dir / "out/pareto.csv");
  std::filesystem::remove(dir / "out/pareto.runs");
  const Outcome unknown = study("test");
  CHECK(unknown.code == 2);
  CHECK_THAT(unknown.text, Catch::Contains("no pareto.runs"));
  CHECK(contents(dir / "out/pareto.csv") == table);
  std::ofstream(dir / "out/pareto.runs") << "echofuse 0.0.1" << runs.substr(runs.find('\n'));
  CHECK_THAT(study("test").text, Catch::Contains("another version of echofuse"));
  std::ofstream(dir / "out/pareto.runs") << runs;
  CHECK(study("test").code == 0);
}

TEST_CASE("a chart that cannot be written leaves the table that was there") {
  const Folder dir;
  std::ofstream(dir / "x.csv") << "all of it\n";
  std::filesystem::create_directory(dir / "x.csv.part");
  CHECK_THROWS_AS(write_chart(dir.path.string(), "x", "new\n", "quit\n"), Error);
  CHECK(contents(dir / "x.csv") == "all of it\n");
}
