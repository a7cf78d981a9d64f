// SPDX-License-Identifier: MIT
#include "recon/models/mask_loss.hpp"
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

TEST_CASE("training stops early, keeps the weights of the best epoch and logs each loss") {
  TrainOptions options = quiet_options("mlp-48-24", 400);
  options.fit.batch = 16, options.fit.patience = 5;
  const TrainingLog log = train(plates(), options).first().log;
  CHECK(log.loss.size() < 400);
  CHECK(log.loss.size() == log.best_epoch + 5);
  CHECK(log.validation_loss.size() == log.loss.size());
  CHECK(std::ranges::min(log.validation_loss) == log.validation_loss[log.best_epoch - 1]);
}

TEST_CASE("evaluation scores the model and three baseline methods on the held-out records") {
  const TrainedModel model = trained_model("ridge", 600);
  const Rows rows = rows_to_evaluate(model, plates(), false);
  CHECK(rows.size() == 60);
  CHECK(rows_to_evaluate(model, plates(), true).size() == 600);
  CHECK(rows_to_evaluate(model, load_plates(10, 9), false).size() == 10);
  const Rows seen = model.rows_of(plates(), Subset::train);
  const auto baselines = score_baselines(plates(), rows, model.first().scene, plates(), seen);
  REQUIRE(baselines.size() == 3);
  CHECK(baselines[0].name == "empty");
  CHECK(baselines[0].metrics[metric_iou].mean == 0);
  CHECK(baselines[2].metrics[metric_iou].mean > 0.3);
  // Each pair of records shows a plate and the mirror image of the plate. The ghost of one plate is
  // therefore at the position of the other plate.
  const Dataset pairs = load_plates(60, 5, [](FusedRecord& r) {
    Rng rng = make_rng(5, static_cast<std::uint64_t>(r.index / 2));
    std::uniform_real_distribution<double> any_x(-1, 1), any_z(3, 4);
    const double x = any_x(rng), z = any_z(rng);
    Rng noise = make_rng(6, static_cast<std::uint64_t>(r.index));
    r = plate_record(r.index, r.index % 2 ? -x : x, z, noise);
  });
  const auto both = score_baselines(pairs, rows_to_evaluate(model, pairs, true),
                                    model.first().scene, plates(), seen);
  CHECK(both[1].metrics[metric_ghost].mean == Approx(0.5).epsilon(1e-6));
}

TEST_CASE("gradients of the mask loss equal central differences in both precisions") {
  const std::vector<float> truth = {0, 1.2f, 3, 0, 5, 2.5f}, background = {0, 0, 0, 5, 5, 5};
  const std::vector<double> outputs = {-2, 0.5, 30, -40, 1e-3, -1, 3, 1.1, 3.2, 2, 4.9, 0.5};
  constexpr double spread_m = 0.8, step = 1e-6;
  const auto loss = [&](std::vector<double> at) {
    return mask_loss<double>(truth, background, spread_m, at);
  };
  std::vector<double> slopes = outputs;
  mask_loss<double>(truth, background, spread_m, slopes);
  std::vector<float> single(outputs.begin(), outputs.end());
  CHECK(mask_loss<float>(truth, background, 0.8f, single) == Approx(loss(outputs)).epsilon(1e-5));
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    auto up = outputs, down = outputs;
    up[i] += step, down[i] -= step;
    CAPTURE(i);
    CHECK(slopes[i] == Approx((loss(up) - loss(down)) / (2 * step)).margin(1e-7));
    CHECK(double{single[i]} == Approx(slopes[i]).margin(1e-5));
  }
  // Outputs 6, 9 and 10 are the predicted depths of the three pixels without an object. These
  // depths must not affect the loss.
  for (const std::size_t i : {6u, 9u, 10u}) CHECK(slopes[i] == 0);
}

TEST_CASE("a network with mask and depth outputs scores better than a depth regression") {
  const auto scores = [&](const char* model) {
    TrainOptions options = quiet_options(model, 40);
    options.fit.batch = 16, options.fit.learning_rate = 4e-3;
    const TrainedModel trained = train(plates(), options);
    return scores_of(trained, plates(), rows_to_evaluate(trained, plates(), false));
  };
  const Summaries masked = scores("mlp-mask-48-24"), regressed = scores("mlp-48-24");
  CHECK(masked[metric_iou].mean > regressed[metric_iou].mean);
  CHECK(regressed[metric_iou].mean > 0.6);
  CHECK(regressed[metric_ghost].mean < 0.1);
  CHECK(masked[metric_depth_mae_m].mean < regressed[metric_depth_mae_m].mean);
  CHECK(masked[metric_left_right].mean > 0.95);
}
