// SPDX-License-Identifier: MIT
// Tests model selection: layer sizes in model names, and the one-standard-error rule.

#include "recon/train/crossvalidate.hpp"
#include "world.hpp"

namespace {

CrossvalidatedRow row(const std::string& name, double iou, double se, std::size_t multiply_adds) {
  CrossvalidatedRow out{{name, {}}, {multiply_adds, 0}, 0, {}};
  out.metrics[metric_iou] = {iou, se, 100};
  // A NaN IoU means that no map was scored, so the RMSE is also NaN.
  if (std::isnan(iou)) out.metrics[metric_rmse_m] = {iou, iou, 0};
  return out;
}

std::string chosen(const std::vector<CrossvalidatedRow>& rows) {
  return rows[cheapest_within_one_se(rows)].name;
}

}  // namespace

TEST_CASE("layer sizes come from the model name, and other training settings come from options") {
  FitOptions given;
  given.epochs = 7;
  const Candidate wide = candidate_of("mlp-1024-512-256", given);
  CHECK(wide.model == "mlp");
  CHECK(wide.fit.hidden.value() == std::vector<std::size_t>{1024, 512, 256});
  CHECK(wide.fit.epochs.value() == 7);
  CHECK(wide.fit.patience.value() == 15);
  CHECK(candidate_of("mlp", {}).fit.hidden.value() == std::vector<std::size_t>{512, 256});
  CHECK(candidate_of("factorised-8", {}).fit.basis.value() == 8);
  CHECK(candidate_of(usual_model(true), {}).fit.basis.value() == 16);
  CHECK(usual_model(false) == "pca-mlp-256-256");
  Dataset data = load_plates(2);
  CHECK(shows_sides(data, Inputs::fused));
  CHECK_FALSE(shows_sides(data, Inputs::spd));
  data.spd().axis.zones.resize(9);
  CHECK(shows_sides(data, Inputs::spd));
  CHECK_FALSE(shows_sides(data, Inputs::radar));
  CHECK(candidate_of("paper", {}).name == "mlp-512-256");
  CHECK(candidate_of("factorised-64", {}).fit.basis.value() == 64);
  CHECK(candidate_of("pca-mlp-32-16", {}).fit.basis.value() == 128);
  CHECK(candidate_of("pca-mlp", {}, 2999).fit.batch.value() == 64);
  CHECK(candidate_of("pca-mlp", {}, 3000).fit.batch.value() == 128);
  CHECK(candidate_of("factorised", {}, 3000).fit.batch.value() == 64);
  CHECK(candidate_of("mlp", {}, 2999).fit.learning_rate.value() == 0.002);
  CHECK(candidate_of("mlp", {}, 3000).fit.learning_rate.value() == Approx(0.002 * std::sqrt(2)));
  // A batch size given by the user overrides the default.
  given.batch = 32;
  CHECK(candidate_of("mlp", given, 3000).fit.batch.value() == 32);
  CHECK(candidate_of("mlp", given, 3000).fit.learning_rate.value() == 0.002);
  given.batch = 256;
  CHECK(candidate_of("mlp", given, 3000).fit.learning_rate.value() == Approx(0.004));
  given.learning_rate = 0.001;
  CHECK(candidate_of("mlp", given, 3000).fit.learning_rate.value() == 0.001);
  for (const char* name :
       {"oracle", "mlp-", "mlp-0", "mlp-12x", "mlp512", "factorised-8-8", "ridge-5", "mlp_8",
        "mlp-8-", "factorised-9999", "oracle-5", "512", ""}) {
    CAPTURE(name);
    CHECK_THROWS_AS(candidate_of(name, {}), Error);
  }
}

TEST_CASE("model selection chooses the cheapest model within one standard error of the best") {
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

TEST_CASE("train --model auto marks the chosen model in a table and refuses unknown candidates") {
  const ReconFolder dir;
  a_run(160).write(dir / "run");
  const Outcome o =
      dir.recon("train --model auto --set candidates=empty,mean,mean-shape,nearest --out m.h5 run");
  CAPTURE(o.text);
  REQUIRE(o.code == 0);
  CHECK_THAT(o.text, Catch::Contains("<- chosen"));
  CHECK_THAT(o.text, Catch::Contains("mean-shape on fused"));
  CHECK_THAT(dir.done("train --model auto --set candidates=empty,oracle --out m.h5 run", 2),
             Catch::Contains("oracle"));
}

TEST_CASE("train --model auto does not use the test records to choose the model") {
  const ReconFolder dir;
  // Returns the table of candidates without the training times.
  const auto table = [&](const std::string& name, const Change& change) {
    a_run(160, 1, change).write(dir / name);
    const Outcome o = dir.recon(
        "train --model auto --split blocked --set candidates=empty,mean,mean-shape,nearest --out "
        "m-" +
        name + " " + name);
    CAPTURE(o.text);
    REQUIRE(o.code == 0);
    std::string rows;
    std::istringstream lines(o.text);
    for (std::string line; std::getline(lines, line);)
      if (std::size_t(std::count(line.begin(), line.end(), '.')) >= 4)
        rows += line.substr(0, line.find_last_not_of(" <-chosen0123456789.")) + '\n';
    return rows;
  };
  // The test records are the last tenth of a blocked split. They show other scenes in the second
  // run, so that each candidate has other scores on them.
  const std::string usual = table("usual", {}),
                    changed = table("changed", [](record::FusedRecord&r) {
                      if (r.index < 144) return;
                      std::ranges::reverse(counts(r));
                      std::ranges::reverse(power(r));
                      std::ranges::reverse(depth_mm(r));
                    });
  CHECK(std::count(usual.begin(), usual.end(), '\n') >= 4);
  CHECK(usual == changed);
}

TEST_CASE("cross-validation of a sequence keeps the gap between training and test records") {
  const Dataset data = load_plates(120);
  const Rows once = rows_to_train(data, Inputs::fused).rows;
  // Each record occurs 15 times in a row, so the borders of the folds at rows 22, 45 and 67 of 90
  // lie within such a group, except for the second one.
  Rows held;
  for (std::size_t i = 0; i < 6; ++i) held.insert(held.end(), 15, once[i]);
  TrainOptions options = quiet_options("auto");
  options.candidates = {"nearest"}, options.split.kind = "blocked";
  const auto iou = [&](std::size_t gap) {
    options.split.gap = gap;
    return crossvalidate(data, held, options).front().metrics[metric_iou].mean;
  };
  CHECK(iou(0) > iou(15) + 0.2);
}

TEST_CASE("model selection uses RMSE if no depth map has foreground") {
  const auto of_rmse = [](const std::string& name, double rmse_m, std::size_t multiply_adds) {
    CrossvalidatedRow out = row(name, std::nan(""), std::nan(""), multiply_adds);
    out.metrics[metric_rmse_m] = {rmse_m, 0.001, 100};
    return out;
  };
  const std::vector rows{of_rmse("mean", .678, 0), of_rmse("wide", .001, 900),
                         of_rmse("ridge", .0015, 500)};
  CHECK(chosen(rows) == "ridge");
  CHECK_THAT(to_choice_table(rows, 2), !Catch::Contains("nan"));
}

TEST_CASE("the standard error for a sequence of similar records is computed between folds") {
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
  // All ten records of a fold have the same pose, so there are three independent values rather than
  // thirty.
  const auto held = [&](double iou) {
    return fold({iou, iou, iou, iou, iou, iou, iou, iou, iou, iou});
  };
  const Summary sequence = summarise({held(0.4), held(0.6), held(0.5)}, true)[metric_iou];
  CHECK(sequence.mean == Approx(0.5));
  CHECK(sequence.se == Approx(0.1 / std::sqrt(3)));
  CHECK(sequence.maps == 30);
  // The folds differ in size, and one fold has no value. With K = 2 folds and n = 4 values, the
  // mean is 0.4. The residuals of the fold sums are 0.6 - 3 * 0.4 and 1 - 0.4.
  const Summary uneven =
      summarise({fold({0.2, 0.2, 0.2}), fold({none}), fold({1.0, none})}, true)[metric_iou];
  CHECK(uneven.mean == Approx(0.4));
  CHECK(uneven.se == Approx(std::sqrt(2 * (0.36 + 0.36)) / 4));
  CHECK(std::isnan(summarise({held(0.4)}, true)[metric_iou].se));
  CHECK(std::isnan(summarise({held(0.4), held(0.5)}, true)[metric_lateral_m].mean));
}

TEST_CASE("blocked cross-validation does not treat repeated records of one pose as independent") {
  const Dataset data = load_plates(120);
  const Rows once = rows_to_train(data, Inputs::fused).rows;
  // `held` contains each record five times in a row.
  Rows held;
  for (std::size_t i = 0; i < 24; ++i) held.insert(held.end(), 5, once[i]);
  TrainOptions options = quiet_options("auto");
  options.candidates = {"mean-shape"}, options.split.gap = 5;
  const auto error = [&](const char* split) {
    options.split.kind = split;
    return crossvalidate(data, held, options).front().metrics[metric_iou].se;
  };
  CHECK(error("blocked") > 1.5 * error("random"));
}

TEST_CASE("train warns if a network is never better than the mean map") {
  const ReconFolder dir;
  a_run(160).write(dir / "moving");
  // All maps of this run are equal, so the mean map predicts them without error.
  a_run(160, 1, [](FusedRecord& r) {
    depth_mm(r).assign(depth_mm(r).size(), 0);
    std::fill_n(depth_mm(r).begin() + 1000, 1000, std::uint16_t{3000});
  }).write(dir / "still");
  const auto train = [&](const std::string& run) {
    return dir.recon("train --model mlp-64 --epochs 20 --out of-" + run + " " + run);
  };
  const Outcome still = train("still"), moving = train("moving");
  CHECK(still.code == 0);
  CHECK_THAT(
      still.text,
      Catch::Contains("s; the network was never better than a prediction of the mean map\n"));
  CHECK(moving.code == 0);
  CHECK_THAT(moving.text, !Catch::Contains("never better"));
}
