// SPDX-License-Identifier: MIT
#include "recon/data/augment.hpp"

#include "recon/estimator/evaluate.hpp"
#include "recon/estimator/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::recon_program;

namespace {

const Dataset& plates() {
  static const Dataset data = testing::load_plates(400);
  return data;
}

// The noisy copies of `rows`.
Matrix copies(Rows rows, std::uint64_t seed = 1) {
  Dataset data = plates();
  const std::size_t before = rows.size();
  augment(data, rows, {"noise"}, seed);
  REQUIRE(rows.size() == 2 * before);
  REQUIRE(data.size() == plates().size() + before);
  REQUIRE(data.clicks_a_pulse.size() == data.size());
  for (std::size_t i = 0; i < before; ++i) {
    const auto a = data.depth.row(rows[i]), b = data.depth.row(rows[before + i]);
    REQUIRE(std::equal(a.begin(), a.end(), b.begin()));
    const auto c = data.spd.row(rows[i]), d = data.spd.row(rows[before + i]);
    REQUIRE(std::equal(c.begin(), c.end(), d.begin()));
  }
  return take_rows(data.radar, {rows.begin() + static_cast<std::ptrdiff_t>(before), rows.end()});
}

}  // namespace

TEST_CASE("noise is that of the SNR it is made for") {
  const Rows rows = all_rows(400);
  const Matrix noisy = copies(rows);
  // Peaks of 1: deviations from 0.01 (20 dB) to 0.1 (10 dB), evenly spread in decibel.
  double squares = 0, least = 1, most = 0;
  for (std::size_t i = 0; i < noisy.rows; ++i) {
    double sum = 0;
    for (std::size_t k = 0; k < noisy.cols; ++k)
      sum += std::pow(double{noisy.row(i)[k]} - double{plates().radar.row(i)[k]}, 2);
    const double deviation = std::sqrt(sum / static_cast<double>(noisy.cols));
    squares += deviation * deviation / static_cast<double>(noisy.rows);
    least = std::min(least, deviation), most = std::max(most, deviation);
  }
  CHECK(squares == Approx((0.01 - 0.0001) / (2 * std::log(10.))).epsilon(0.15));
  CHECK(least == Approx(0.01).epsilon(0.4));
  CHECK(most == Approx(0.1).epsilon(0.4));
  CHECK(copies(rows, 1).values == noisy.values);
  CHECK(copies(rows, 2).values != noisy.values);
}

TEST_CASE("a model trained on noisy copies stands noise better") {
  Dataset noisy = plates();
  Rng rng = make_rng(4, 0);
  std::normal_distribution<float> noise(0, 0.1f);
  for (float& v : noisy.radar.values) v += noise(rng);
  const auto iou = [&](const std::vector<std::string>& kinds) {
    TrainOptions options;
    options.uncertainty = false;
    options.model = "factorised-4";
    options.augment = kinds;
    options.fit.quiet = true;
    const TrainedModel model = train(plates(), options);
    CHECK(model.rows_of(plates(), Part::train).size() == 342);  // the copies are not remembered
    const Rows rows = model.rows_of(plates(), Part::test);
    return summarise(score_maps(model.predict(noisy, rows), noisy, rows, model->scene))[metric_iou]
        .mean;
  };
  CHECK(iou({"noise"}) > 1.05 * iou({}));
}

TEST_CASE("kinds of the radar are refused for the SPD alone before anything is tried") {
  TrainOptions options;
  options.uncertainty = false;
  options.model = "auto", options.inputs = "spd", options.augment = {"noise"};
  options.candidates = {"not a model"}, options.fit.quiet = true;
  CHECK_THROWS_WITH(train(plates(), options), Catch::Contains("--inputs spd has none"));
}

TEST_CASE("an unknown kind is refused") {
  const auto o = recon_program("train none --out m --set augment=dust");
  CHECK(o.code == 3);
  CHECK_THAT(o.text, Catch::Contains("dust"));
}
