// SPDX-License-Identifier: MIT
#include "recon/models/model.hpp"
#include "world.hpp"

namespace {

Matrix random_matrix(std::size_t rows, std::size_t cols, std::uint64_t seed) {
  Rng rng = make_rng(seed, 0);
  std::normal_distribution<float> normal;
  Matrix out(rows, cols);
  for (float& v : out.values) v = normal(rng);
  return out;
}

TrainOptions quick(const std::string& model) {
  TrainOptions options = quiet_options(model, 25);
  options.fit.hidden = {48, 24}, options.fit.batch = 16;
  return options;
}

// Returns a data set of plates. It is loaded only once and shared by all test cases.
const Dataset& plates() {
  static const Dataset data = load_plates(600);
  return data;
}

}  // namespace

TEST_CASE("the nearest-neighbour model returns the stored map of a training record") {
  const Matrix x = random_matrix(20, 10, 5), y = random_matrix(20, 4096, 6);
  const auto nearest = kind_of("nearest").make();
  nearest->fit({x, y, all_rows(20)}, {x, y, {}}, {});
  CHECK(nearest->predict(x).values == y.values);
  const std::size_t looked_up = nearest->cost().multiply_adds;
  CHECK(looked_up == x.values.size());
  FitOptions five;
  five.basis = 5;
  nearest->fit({x, y, all_rows(20)}, {x, y, {}}, five);
  CHECK(nearest->cost().multiply_adds == looked_up + 5 * y.cols);
}

TEST_CASE(
    "fused inputs score better than the SPD alone, because the SPD cannot tell left from right") {
  const auto scores = [](const char* inputs) {
    TrainOptions options = quick("mlp");
    options.inputs = inputs;
    const TrainedModel model = train(plates(), options);
    return scores_of(model, plates(), rows_to_evaluate(model, plates(), false));
  };
  const Summaries fused = scores("fused"), spd = scores("spd");
  CHECK(fused[metric_iou].mean > 0.6);
  CHECK(fused[metric_left_right].mean > 0.95);
  CHECK(fused[metric_ghost].mean < spd[metric_ghost].mean / 4);
  CHECK(fused[metric_iou].mean > spd[metric_iou].mean + 0.3);
  // If only SPD data are used, most maps have no foreground. In the other maps, the object is on
  // the correct side in half of the cases (within 4 standard deviations), because the ghost is
  // nearly as strong as the object.
  if (const double n = static_cast<double>(spd[metric_left_right].maps); n > 0)
    CHECK(std::abs(spd[metric_left_right].mean - 0.5) < 4 * 0.5 / std::sqrt(n));
  CHECK(spd[metric_lateral_m].maps < fused[metric_lateral_m].maps / 2);
  CHECK(spd[metric_ghost].mean > 0.4);
}

TEST_CASE(
    "training stops early, keeps the weights of the best epoch and logs the loss of each epoch") {
  TrainOptions options = quick("mlp");
  options.fit.epochs = 400;
  options.fit.patience = 5;
  const TrainingLog log = train(plates(), options).first().log;
  CHECK(log.loss.size() < 400);
  CHECK(log.loss.size() == log.best_epoch + 5);
  CHECK(log.validation_loss.size() == log.loss.size());
  CHECK(*std::min_element(log.validation_loss.begin(), log.validation_loss.end()) ==
        log.validation_loss[log.best_epoch - 1]);
}

TEST_CASE("evaluation scores the model and three baseline methods on the held-out records") {
  const TrainedModel model = trained_model("ridge", 600);
  const Rows rows = rows_to_evaluate(model, plates(), false);
  CHECK(rows.size() == 60);
  CHECK(rows_to_evaluate(model, plates(), true).size() == 600);
  const Rows seen = model.rows_of(plates(), Subset::train);
  const auto baselines = score_baselines(plates(), rows, model.first().scene, plates(), seen);
  REQUIRE(baselines.size() == 3);
  CHECK(baselines[0].name == "empty");
  CHECK(baselines[0].metrics[metric_iou].mean == 0);
  CHECK(baselines[2].metrics[metric_iou].mean > 0.3);
  const Folder dir;
  // Each pair of records shows a plate and the mirror image of the plate. The ghost of one plate is
  // therefore at the position of the other plate.
  a_run(60, 5, [](FusedRecord& r) {
    Rng rng = make_rng(5, static_cast<std::uint64_t>(r.index / 2));
    std::uniform_real_distribution<double> any_x(-1, 1), any_z(3, 4);
    const double x = any_x(rng), z = any_z(rng);
    Rng noise = make_rng(6, static_cast<std::uint64_t>(r.index));
    r = plate_record(r.index, r.index % 2 ? -x : x, z, noise);
  }).write(dir / "pairs");
  const Dataset pairs = load({dir / "pairs"});
  const auto both = score_baselines(pairs, rows_to_evaluate(model, pairs, true),
                                    model.first().scene, plates(), seen);
  CHECK(both[1].metrics[metric_ghost].mean == Approx(0.5).epsilon(1e-6));
  a_run(10, 9).write(dir / "fresh");
  CHECK(rows_to_evaluate(model, load({dir / "fresh"}), false).size() == 10);
}
