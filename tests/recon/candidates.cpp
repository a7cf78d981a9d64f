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
  CHECK(candidate_of("paper", {}).name == "mlp-512-256");
  for (const auto& [name, basis] : {std::pair<std::string, std::size_t>{"factorised-8", 8},
                                    {"factorised-64", 64},
                                    {"pca-mlp-32-16", 128},
                                    {usual_model(true), 16}})
    CHECK(candidate_of(name, {}).fit.basis.value() == basis);
  CHECK(usual_model(false) == "pca-mlp-256-256");
  Dataset data = load_plates(2);
  CHECK(shows_sides(data, Inputs::fused));
  CHECK_FALSE(shows_sides(data, Inputs::spd));
  data.spd().axis.zones.resize(9);
  CHECK(shows_sides(data, Inputs::spd));
  CHECK_FALSE(shows_sides(data, Inputs::radar));
  for (const char* name :
       {"oracle", "mlp-", "mlp-0", "mlp-12x", "mlp512", "factorised-8-8", "ridge-5", "mlp_8",
        "mlp-8-", "factorised-9999", "oracle-5", "512", ""}) {
    CAPTURE(name);
    CHECK_THROWS_AS(candidate_of(name, {}), Error);
  }
}

TEST_CASE("batch size and learning rate follow the number of records, unless the user sets them") {
  const std::vector<std::tuple<const char*, std::size_t, std::size_t, std::size_t, double>> rows{
      // model, batch size set by the user (0: none), records; expected batch and learning rate
      {"pca-mlp", 0, 2999, 64, 0.002},    {"pca-mlp", 0, 3000, 128, 0.002 * std::sqrt(2)},
      {"factorised", 0, 3000, 64, 0.003}, {"mlp-mask", 0, 2999, 64, 0.001},
      {"mlp", 32, 3000, 32, 0.002},       {"mlp", 256, 3000, 256, 0.004}};
  for (const auto& [name, set, records, batch, rate] : rows) {
    CAPTURE(name, set, records);
    FitOptions given;
    if (set > 0) given.batch = set;
    const FitOptions found = candidate_of(name, given, records).fit;
    CHECK(found.batch.value() == batch);
    CHECK(found.learning_rate.value() == Approx(rate));
    given.learning_rate = 0.001;
    CHECK(candidate_of(name, given, records).fit.learning_rate.value() == 0.001);
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
  const std::string train = "train --model auto --out m.h5 run --set candidates=empty,";
  dir.says(train + "mean,mean-shape,nearest", {"<- chosen", "mean-shape on fused"});
  dir.says(train + "oracle", {"oracle"}, 2);
}

TEST_CASE("train --model auto does not use the test records to choose the model") {
  const ReconFolder dir;
  // Returns the table of candidates without the training times.
  const auto table = [&](const std::string& name, const Change& change) {
    a_run(160, 1, change).write(dir / name);
    std::istringstream lines(dir.done(
        "train --model auto --split blocked --set candidates=empty,mean,mean-shape,nearest "
        "--out m-" +
        name + " " + name));
    std::string rows;
    for (std::string line; std::getline(lines, line);)
      if (std::count(line.begin(), line.end(), '.') >= 4)
        rows += line.substr(0, line.find_last_not_of(" <-chosen0123456789.")) + '\n';
    return rows;
  };
  // The test records are the last tenth of a blocked split. They show other scenes in the second
  // run, so that each candidate has other scores on them.
  const Change other_scenes = [](FusedRecord& r) {
    if (r.index < 144) return;
    std::ranges::reverse(counts(r));
    std::ranges::reverse(power(r));
    std::ranges::reverse(depth_mm(r));
  };
  const std::string usual = table("usual", {});
  CHECK(std::count(usual.begin(), usual.end(), '\n') >= 4);
  CHECK(usual == table("changed", other_scenes));
}

TEST_CASE("cross-validation of a sequence keeps gaps, and counts repeated records of a pose once") {
  const Dataset data = load_plates(120);
  const Rows once = rows_to_train(data, Inputs::fused).rows;
  const auto score = [&](const char* model, std::size_t records, std::size_t times,
                         const char* split, std::size_t gap) {
    Rows held;  // each record occurs several times in a row
    for (std::size_t i = 0; i < records; ++i) held.insert(held.end(), times, once[i]);
    TrainOptions options = quiet_options("auto");
    options.candidates = {model}, options.split.kind = split, options.split.gap = gap;
    return crossvalidate(data, held, options).front().metrics[metric_iou];
  };
  // The borders of the folds are at rows 22, 45 and 67 of 90. Except for the second one, they lie
  // within the 15 copies of a record.
  CHECK(score("nearest", 6, 15, "blocked", 0).mean >
        score("nearest", 6, 15, "blocked", 15).mean + 0.2);
  CHECK(score("mean-shape", 24, 5, "blocked", 5).se >
        1.5 * score("mean-shape", 24, 5, "random", 5).se);
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
  CHECK_THAT(to_choice_table(rows, 2), !Contains("nan"));
}

TEST_CASE("the standard error for a sequence of similar records is computed between folds") {
  const auto fold = [](const std::vector<double>& ious) {
    std::vector<MapScores> out(ious.size());
    for (std::size_t i = 0; i < ious.size(); ++i)
      out[i].fill(std::nan("")), out[i][metric_iou] = ious[i];
    return out;
  };
  const double none = std::nan("");
  // All ten records of a fold have the same pose, so there are three independent values rather than
  // thirty.
  const auto held = [&](double iou) { return fold(std::vector<double>(10, iou)); };
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

TEST_CASE("train warns if a network is never better than the mean map") {
  const ReconFolder dir;
  a_run(160).write(dir / "moving");
  // All maps of this run are equal, so the mean map predicts them without error.
  a_run(160, 1, [](FusedRecord& r) {
    std::ranges::fill(depth_mm(r), 0);
    std::fill_n(depth_mm(r).begin() + 1000, 1000, std::uint16_t{3000});
  }).write(dir / "still");
  const std::string train = "train --model mlp-64 --epochs 20 --set fallback=false --out ";
  dir.says(train + "m still",
           {"s; the network was never better than a prediction of the mean map\n"});
  CHECK_THAT(dir.done(train + "n moving"), !Contains("never better"));
}
