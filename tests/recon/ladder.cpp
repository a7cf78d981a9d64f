// SPDX-License-Identifier: MIT
// Which model: sizes by name, the one-standard-error rule, and the study of accuracy against cost.
#include <fstream>
#include <sstream>

#include "recon/crossvalidate.hpp"
#include "recon/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {

CrossvalidatedRow row(const std::string& name, double iou, double se, std::size_t multiply_adds) {
  CrossvalidatedRow out{{name, {}}, {multiply_adds, 0}, 0, {}};
  out.metrics[metric_iou] = {iou, se, 100};
  return out;
}

std::string chosen(const std::vector<CrossvalidatedRow>& rows) {
  return rows[cheapest_within_one_se(rows)].name;
}

}  // namespace

TEST_CASE("a model's name may carry its size, and options fill the rest") {
  FitOptions given;
  given.epochs = 7;
  const Rung wide = rung_of("mlp-1024-512-256", given);
  CHECK(wide.model == "mlp");
  CHECK(wide.fit.hidden.value() == std::vector<std::size_t>{1024, 512, 256});
  CHECK(wide.fit.epochs.value() == 7);
  CHECK(wide.fit.patience.value() == 15);
  CHECK(rung_of("mlp", {}).fit.hidden.value() == std::vector<std::size_t>{512, 256});
  CHECK(rung_of("factorised-8", {}).fit.basis.value() == 8);
  CHECK(rung_of("factorised", {}).fit.basis.value() == 16);
  CHECK(rung_of("pca-ridge-64", {}).fit.basis.value() == 64);
  CHECK(rung_of("pca-mlp-32-16", {}).fit.basis.value() == 128);
  for (const char* name : {"oracle", "mlp-", "mlp-0", "mlp-12x", "mlp512", "factorised-8-8",
                           "ridge-5", "mlp_8", "mlp-8-", "pca-ridge-9999", "oracle-5", "512", ""}) {
    CAPTURE(name);
    CHECK_THROWS_AS(rung_of(name, {}), Error);
  }
}

TEST_CASE("the cheapest model within one standard error of the best is chosen") {
  CHECK(chosen({row("cheap", 0.50, 0.01, 10), row("good", 0.58, 0.01, 100),
                row("best", 0.585, 0.01, 1000)}) == "good");
  CHECK(chosen({row("cheap", 0.50, 0.01, 10), row("good", 0.57, 0.01, 100),
                row("best", 0.585, 0.01, 1000)}) == "best");
  CHECK(chosen({row("dear", 0.59, 0.01, 1000), row("cheap", 0.585, 0.01, 10)}) == "cheap");
  CHECK(chosen({row("only", 0, 0, 0)}) == "only");
  const double none = std::nan("");
  CHECK(chosen({row("unfit", none, none, 0), row("fit", 0.1, 0.01, 5)}) == "fit");
  CHECK_THROWS_AS(chosen({row("unfit", none, none, 0)}), Error);
}

TEST_CASE("train --model auto keeps what does best for its cost, and says why") {
  const Folder dir;
  write_run(dir / "run", 400);
  const Outcome o =
      recon_program("train --model auto --ladder empty,mean,silhouette,nearest --out " +
                    (dir / "m.h5") + " " + (dir / "run"));
  CAPTURE(o.text);
  REQUIRE(o.code == 0);
  CHECK_THAT(o.text, Catch::Contains("<- chosen"));
  CHECK_THAT(o.text, Catch::Contains("silhouette on fused"));
  const Outcome bad = recon_program("train --model auto --ladder empty,oracle --out " +
                                    (dir / "m.h5") + " " + (dir / "run"));
  CHECK(bad.code == 2);
  CHECK_THAT(bad.text, Catch::Contains("oracle"));
}

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
  CHECK(std::distance(std::filesystem::directory_iterator(dir / "out"), {}) == 3);
  const Outcome same = recon_program("study pareto " + (dir / "train") + " " + (dir / "train") +
                                     " --out " + (dir / "same"));
  CHECK(same.code == 2);
  CHECK_THAT(same.text, Catch::Contains("the models are trained on this run"));
}
