// SPDX-License-Identifier: MIT
#include "recon/models/mask_loss.hpp"

#include "world.hpp"

TEST_CASE("gradients of the mask loss equal central differences") {
  const std::vector<float> truth = {0, 1.2f, 3, 0, 5, 2.5f}, background = {0, 0, 0, 5, 5, 5};
  const std::vector<double> outputs = {-2, 0.5, 30, -40, 1e-3, -1, 3, 1.1, 3.2, 2, 4.9, 0.5};
  constexpr double spread_m = 0.8, step = 1e-6;
  const auto loss = [&](std::vector<double> at) {
    return mask_loss<double>(truth, background, spread_m, at);
  };
  std::vector<double> slopes = outputs;
  mask_loss<double>(truth, background, spread_m, slopes);
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    auto up = outputs, down = outputs;
    up[i] += step, down[i] -= step;
    CAPTURE(i);
    CHECK(slopes[i] == Approx((loss(up) - loss(down)) / (2 * step)).margin(1e-7));
  }
  // Outputs 6, 9 and 10 are the predicted depths of the three pixels without an object. These
  // depths must not affect the loss.
  for (const std::size_t i : {6u, 9u, 10u}) CHECK(slopes[i] == 0);
}

TEST_CASE("the mask loss in single precision matches that in double precision") {
  const std::vector<float> truth = {0, 3, 2}, background(3);
  std::vector<float> a = {80, -80, 0.1f, 9, 3.5f, 2};
  std::vector<double> b(a.begin(), a.end());
  CHECK(mask_loss<float>(truth, background, 0.5f, a) ==
        Approx(mask_loss<double>(truth, background, 0.5, b)).epsilon(1e-5));
  for (std::size_t i = 0; i < a.size(); ++i) CHECK(double{a[i]} == Approx(b[i]).margin(1e-5));
}

TEST_CASE("a network with mask and depth outputs scores better than a depth regression") {
  const Dataset data = load_plates(600);
  const auto scores = [&](const char* model) {
    TrainOptions options = quiet_options(model, 40);
    options.fit.batch = 16, options.fit.learning_rate = 4e-3;
    const TrainedModel trained = train(data, options);
    return scores_of(trained, data, rows_to_evaluate(trained, data, false));
  };
  const Summaries masked = scores("mlp-mask-48-24"), regressed = scores("mlp-48-24");
  CHECK(masked[metric_iou].mean > regressed[metric_iou].mean);
  CHECK(masked[metric_depth_mae_m].mean < regressed[metric_depth_mae_m].mean);
  CHECK(masked[metric_left_right].mean > 0.95);
}
