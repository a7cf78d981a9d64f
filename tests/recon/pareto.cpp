// SPDX-License-Identifier: MIT
// The study of accuracy against cost.
#include <signal.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "recon/study/study.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {

// "AXIS MODEL" of each row.
std::string measured(const std::string& file) {
  std::istringstream in(contents(file));
  std::string out;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("# ") || line.starts_with("axis,")) continue;
    std::istringstream cells(line);
    std::string axis, value, model;
    std::getline(std::getline(std::getline(cells, axis, ','), value, ','), model, ',');
    out += axis + " " + model + "\n";
  }
  return out;
}

}  // namespace

TEST_CASE("study pareto: a row a model, share and seed, the front marked, a chart") {
  const Folder dir;
  write_run(dir / "train", 200);
  write_run(dir / "test", 40, 5);
  const Outcome o = recon_program(
      "study pareto " + (dir / "train") + " " + (dir / "test") + " -q --seeds 2 --out " +
      (dir / "out") + " --models empty,silhouette,nearest,mean:spd --sweep-models silhouette " +
      "--photons 0.1 --records 0.5");
  CAPTURE(o.text);
  REQUIRE(o.code == 0);
  std::vector<std::string> begins, fronts;
  std::istringstream text(o.text);
  std::string line;
  for (std::getline(text, line); std::getline(text, line);) {
    std::istringstream words(line);
    std::string sweep, share, model;
    words >> sweep >> share >> model;
    begins.push_back(sweep + "," + share + "," + model);
    if (line.ends_with("  front")) fronts.push_back(begins.back());
  }
  CHECK(begins == std::vector<std::string>{"model,1,empty", "model,1,silhouette", "model,1,nearest",
                                           "model,1,mean:spd", "photons,0.1,silhouette",
                                           "records,0.5,silhouette"});
  CHECK(std::count(fronts.begin(), fronts.end(), "model,1,silhouette") == 1);
  std::ifstream csv(dir / "out/pareto.csv");
  std::string header;
  while (std::getline(csv, header) && header.starts_with("# ")) continue;
  CHECK(header.starts_with("axis,value,model,inputs,machine,seed,iou,"));
  std::size_t rows = 0;
  for (; std::getline(csv, line); ++rows)
    CHECK(std::count(line.begin(), line.end(), ',') ==
          std::count(header.begin(), header.end(), ','));
  CHECK(rows == 2 * begins.size());
  CHECK_THAT(contents(dir / "out/pareto.html"), Catch::Contains("Worth their time: "));
  CHECK(std::distance(std::filesystem::directory_iterator(dir / "out"), {}) == 2);
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
  const std::string file = dir / "out/pareto.csv";
  const auto study = [&](const std::string& models, const std::string& more = {},
                         const std::string& records = "0.5") {
    return recon_program("study pareto " + (dir / "train") + " " + (dir / "test") +
                         " -q --seeds 1 --out " + (dir / "out") + " --models " + models +
                         " --sweep-models silhouette --photons 0.1 --records " + records + more);
  };
  const Outcome stopped = study("empty,mean", {}, "1e-9");  // of one record nothing can be learnt
  CAPTURE(stopped.text);
  REQUIRE(stopped.code != 0);
  CHECK(measured(file) == "model empty\nmodel mean\nphotons silhouette\n");
  std::string begun = contents(file);
  begun.replace(begun.find(",1,0,") + 3, 1, "0.0625");  // the empty room's IoU
  // A killed process leaves part of a line, which goes.
  std::ofstream(file) << begun << begun.substr(begun.rfind("photons"), 60);

  const Outcome more = study("empty,mean,silhouette", " --bound 0.0375,0.0125");
  CAPTURE(more.text);
  REQUIRE(more.code == 0);
  CHECK(contents(file).starts_with(begun));
  CHECK(measured(file) ==
        "model empty\nmodel mean\nphotons silhouette\nmodel silhouette\nrecords silhouette\n");
  CHECK_THAT(more.text, Catch::Contains("empty                0.062 +-"));
  CHECK_THAT(contents(dir / "out/pareto.html"), Catch::Contains("least possible: 3.75 cm") &&
                                                    Catch::Contains("with known shape: 1.25 cm"));
  CHECK(study("empty", " --bound 0.0375").code == 2);
  CHECK(study("empty", " --bound 0.0375,0").code == 2);

  const std::string all = contents(file);
  CHECK(study("empty").code == 0);
  CHECK(contents(file) == all);
}

TEST_CASE("study pareto keeps what is measured, and no row of a training that was broken off") {
  const Folder dir;
  write_run(dir / "train", 1000);
  write_run(dir / "test", 40, 5);
  for (const bool killed : {false, true}) {
    const std::string out = dir / (killed ? "killed" : "interrupted"), file = out + "/pareto.csv";
    const pid_t child =
        start_recon({"study", "pareto", dir / "train", dir / "test", "-q", "--seeds", "1",
                     "--models", "empty,mlp-1024-1024", "--out", out});
    while (kill(child, 0) == 0 && measured(file) != "model empty\n") ::usleep(10'000);
    ::usleep(500'000);
    if (killed) {
      kill(child, SIGKILL);
      waitpid(child, nullptr, 0);
    } else {
      CHECK(interrupted_code(child) == 130);
    }
    CHECK(measured(file) == "model empty\n");
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
  const std::string file = dir / "out/pareto.csv", table = contents(file);
  const Outcome other = study("third");
  CHECK(other.code == 2);
  CHECK_THAT(other.text, Catch::Contains("pareto.csv: was measured with \"# test ") &&
                             Catch::Contains("\" (now: \"# test ") &&
                             Catch::Contains("give the same settings, or another folder"));
  std::string old = table;
  old.replace(old.find("# echofuse ") + 11, 1, "\x1b");
  std::ofstream(file) << old;
  const Outcome older = study("test");
  CHECK(older.code == 2);
  CHECK_THAT(older.text, Catch::Contains("measured with \"# echofuse \\x1b"));
  CHECK(contents(file) == old);
  std::filesystem::remove(file);
  const Outcome unknown = study("test");
  CHECK(unknown.code == 2);
  CHECK_THAT(unknown.text, Catch::Contains("pareto.csv is missing"));
  CHECK_FALSE(std::filesystem::exists(file));
}

TEST_CASE("nothing of a study file is believed") {
  const Folder dir;
  write_run(dir / "train", 60);
  write_run(dir / "test", 40, 5);
  const std::string file = dir / "out/pareto.csv";
  const auto study = [&] {
    return recon_program("study pareto " + (dir / "train") + " " + (dir / "test") +
                         " -q --seeds 1 --models mean --photons 1 --records 1 --sweep-models mean" +
                         " --out " + (dir / "out"));
  };
  REQUIRE(study().code == 0);
  const std::string sound = contents(file), head = sound.substr(0, sound.find("model,1,"));
  const auto refused = [&](const std::string& text, int code, const std::string& saying) {
    std::ofstream(file, std::ios::binary) << text;
    const Outcome o = study();
    CAPTURE(text, o.text);
    CHECK(o.code == code);
    CHECK_THAT(o.text, Catch::Contains("pareto.csv: " + saying));
    CHECK(std::count(o.text.begin(), o.text.end(), '\n') == 1);
    CHECK(contents(file) == text);
  };
  refused("sweep,share\nmodel,1\n", 3, "is not the file of a study");
  refused("mine", 3, "is not the file of a study");
  refused(std::string(5000, '\0'), 3, "is not the file of a study");
  refused("# study stability\n", 3, "is not the file of a study");
  refused("# study pareto\nmodel,1,mean\n", 2, "was measured with \"model,1,mean\" (now: \"# echo");
  const std::string row = sound.substr(head.size(), sound.find('\n', head.size()) - head.size());
  const std::string name = "damaged: \"";
  for (const std::string wrong : {"mean';reboot", "", "a\x1b[2J", "a\"", "<b>"}) {
    std::string changed = row;
    refused(head + changed.replace(changed.find("mean"), 4, wrong) + "\n", 1, name + "model,1,");
  }
  refused(head + row + ",1\n", 1, name + row.substr(0, 20));
  refused(head + row.substr(0, row.size() / 2) + "\n" + row + "\n", 1, name + row.substr(0, 20));
  refused(head + row.substr(0, row.rfind(',')) + ",0.5x\n", 1, name);
  refused(head + "\n", 1, name + "\" is no row of a study");
  for (const std::string& killed : {std::string(), sound.substr(0, 5), head.substr(0, 40), head,
                                    sound.substr(0, sound.size() - 30), sound + head + sound}) {
    std::ofstream(file, std::ios::binary) << killed;
    CAPTURE(killed);
    CHECK(study().code == 0);
    CHECK(measured(file).starts_with("model mean\nphotons mean\nrecords mean\n"));
    CHECK(contents(file).starts_with(head));
  }
}
