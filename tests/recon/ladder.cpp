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
  const auto table = [&] {
    std::ifstream csv(dir / "out/pareto.csv");
    return std::string(std::istreambuf_iterator<char>(csv), {});
  };
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
  std::ifstream script(dir / "out/pareto.gp");
  const std::string gp(std::istreambuf_iterator<char>(script), {});
  CHECK_THAT(gp, Catch::Contains("0.0375 with lines") && Catch::Contains("0.0125 with lines"));
  std::ifstream picture(dir / "out/pareto.svg");
  CHECK_THAT(std::string(std::istreambuf_iterator<char>(picture), {}),
             Catch::Contains("bound: pose unknown"));

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

TEST_CASE("the standard error of a sequence is that of its folds") {
  const auto fold = [](std::initializer_list<double> ious) {
    std::vector<MapScores> out;
    for (const double iou : ious) {
      MapScores scores;
      scores.fill(std::nan(""));
      scores[metric_iou] = iou;
      out.push_back(scores);
    }
    return out;
  };
  const double none = std::nan("");
  // Ten records of each pose: three poses, not thirty.
  const auto held = [&](double iou) {
    return fold({iou, iou, iou, iou, iou, iou, iou, iou, iou, iou});
  };
  const Summary sequence = summarise_folds({held(0.4), held(0.6), held(0.5)})[metric_iou];
  CHECK(sequence.mean == Approx(0.5));
  CHECK(sequence.se == Approx(0.1 / std::sqrt(3)));
  CHECK(sequence.maps == 30);
  // Unequal folds, one without a value: K = 2, n = 4, mean 0.4; rests 0.6 - 3 * 0.4 and 1 - 0.4.
  const Summary uneven =
      summarise_folds({fold({0.2, 0.2, 0.2}), fold({none}), fold({1.0, none})})[metric_iou];
  CHECK(uneven.mean == Approx(0.4));
  CHECK(uneven.se == Approx(std::sqrt(2 * (0.36 + 0.36)) / 4));
  CHECK(std::isnan(summarise_folds({held(0.4)})[metric_iou].se));
  CHECK(std::isnan(summarise_folds({held(0.4), held(0.5)})[metric_lateral_m].mean));
}

TEST_CASE("cross-validation of held poses does not call each record a new one") {
  const Folder dir;
  write_run(dir / "run", 120);
  Dataset data = load({dir / "run"});
  const Rows once = rows_to_train(data, Inputs::fused);
  Rows held;  // every record five times in a row
  for (std::size_t i = 0; i < 24; ++i) held.insert(held.end(), 5, once[i]);
  CrossvalidateOptions options;
  options.models = {"silhouette"};
  options.gap = 5;
  options.fit.quiet = true;
  const double folds = crossvalidate(data, held, options).front().metrics[metric_iou].se;
  options.sequence = false;
  const double maps = crossvalidate(data, held, options).front().metrics[metric_iou].se;
  CHECK(folds > 1.5 * maps);
}
