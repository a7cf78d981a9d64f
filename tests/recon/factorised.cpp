// SPDX-License-Identifier: MIT

#include "recon/method/body_frame.hpp"
#include "recon/method/method.hpp"
#include "world.hpp"

namespace {

const Dataset& plates() {
  static const Dataset data = load_plates(400);
  return data;
}

const TrainedModel& trained() {
  static const TrainedModel model = trained_model("factorised", 400);
  return model;
}

// Returns the inputs aligned to the body, after multiplication by `gain` and the addition of a
// constant background to the histogram.
std::vector<float> aligned(std::vector<float> record, float gain = 1, float background = 0) {
  for (float& v : record) v *= gain;
  for (std::size_t i = 0; i < spd_axis().count; ++i) record[i] += background;
  const Alignment alignment = blank_alignment();
  std::vector<float> out(alignment.size());
  align(record, alignment, out);
  return out;
}

double centroid(std::span<const float> values) {
  double sum = 0, moment = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    sum += double{values[i]};
    moment += double{values[i]} * static_cast<double>(i);
  }
  return moment / sum;
}

}  // namespace

TEST_CASE("inputs aligned to the body do not depend on gain, exposure or a flat background") {
  const auto plain = aligned(one_object(3.5, 3.55));
  for (const auto& other : {aligned(one_object(3.5, 3.55), 4), aligned(one_object(3.5, 3.55), 0.25),
                            aligned(one_object(3.5, 3.55), 1, 40)})
    for (std::size_t i = 0; i < plain.size(); ++i)
      REQUIRE(other[i] == Approx(plain[i]).epsilon(1e-3).margin(1e-5));
}

TEST_CASE("a range difference between radar and histogram shifts the aligned radar profile") {
  const auto a = aligned(one_object(3.3, 3.35)), b = aligned(one_object(3.7, 3.95));
  const double near_m = double{a.back()}, far_m = double{b.back()};
  // Half of the 6 cm bins are near the object, so the median overestimates the background. The
  // tolerance of 1 cm covers the resulting range error.
  CHECK(near_m == Approx(3.3).margin(0.01));
  CHECK(far_m == Approx(3.7).margin(0.01));
  const std::size_t bins = 35;
  const std::span<const float> profile_a = std::span(a).subspan(bins, a.size() - bins - 1);
  const std::span<const float> profile_b = std::span(b).subspan(bins, b.size() - bins - 1);
  // The step of the aligned profile is half a radar bin.
  const double step_m = 0.125;
  CHECK((centroid(profile_b) - centroid(profile_a)) * step_m ==
        Approx(0.2 - (far_m - near_m - 0.4)).margin(0.002));
  CHECK(centroid(std::span(b).first(bins)) ==
        Approx(centroid(std::span(a).first(bins))).margin(0.2));
}

TEST_CASE("no body is detected in the histograms of an empty room") {
  Rng rng = make_rng(3, 0);
  const std::vector<float> nothing(spd_axis().count + radar_axis().count);
  int seen = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    std::poisson_distribution<int> counts(std::array{50., 3., 0.6, 0.1}[trial % 4u]);
    std::vector<float> record = nothing;
    for (std::uint32_t i = 0; i < spd_axis().count; ++i)
      record[i] = static_cast<float>(counts(rng));
    const auto features = aligned(record);
    seen += shows_body(features);
    if (!shows_body(features))
      REQUIRE(std::all_of(features.begin(), features.end(), [](float v) { return v == 0; }));
  }
  CHECK(seen == 0);
  CHECK_FALSE(shows_body(aligned(nothing)));
}

TEST_CASE("a body that is extracted from a depth map is redrawn at the same position") {
  const Matrix& maps = depth_maps(plates());
  const std::vector<float> background(maps.cols, 0);
  const Rows rows = all_rows(50);
  std::vector<Place> places;
  for (const std::size_t row : rows) places.push_back(*place_of(maps.row(row), background, {}));
  const BodyFrame frame(maps, background, rows, places, {});
  // The frame is hardly larger than the object, which covers 24 x 12 pixels.
  CHECK(frame.size() < 30 * 20);
  std::vector<float> mask(frame.size()), relief(frame.size()), drawn;
  for (const std::size_t row : rows) {
    frame.cut(maps.row(row), background, places[row], mask, relief);
    drawn = background;
    frame.draw(mask, relief, places[row], 0.5f, drawn);
    int both = 0, any = 0;
    for (std::size_t p = 0; p < drawn.size(); ++p) {
      const bool a = drawn[p] > 0, b = maps.row(row)[p] > 0;
      both += a && b, any += a || b;
      if (a && b) REQUIRE(drawn[p] == Approx(maps.row(row)[p]).margin(1e-3));
    }
    // If each edge of the object is off by half a pixel, the IoU is about 0.88.
    CHECK(both > 0.85 * any);
  }
}

TEST_CASE("the factorised model places bodies on the correct side for any sensor gain") {
  const Rows rows = trained().rows_of(plates(), Subset::test);
  const Summaries plain = scores_of(trained(), plates(), rows);
  CHECK(plain[metric_iou].mean > 0.7);
  CHECK(plain[metric_left_right].mean > 0.95);
  Dataset louder = plates();
  for (float& v : profiles(louder).values) v *= 4;
  for (float& v : photons(louder).values) v *= 0.5f;
  CHECK(scores_of(trained(), louder, rows)[metric_iou].mean > 0.98 * plain[metric_iou].mean);
}

TEST_CASE("clicks in a bin that only one training record uses do not shift the predicted body") {
  Dataset data = load_plates(200);
  const auto around = [&](std::size_t row) {
    const auto clicks = photons(data).row(row);
    return std::max_element(clicks.begin(), clicks.end());
  };
  for (std::size_t row = 0; row < data.size(); ++row)
    std::replace_if(
        around(row) - 9, around(row) - 5, [](float) { return true; }, 0.f);
  *(around(0) - 8) = 1;
  TrainOptions options = quiet_options("mean-shape");
  options.split.test_share = 0;
  const TrainedModel model = train(data, options);
  const Rows rows = all_rows(50);
  const Matrix before = model.predict(data, rows);
  // Adds 50 clicks in front of the object, which itself causes 1e5 clicks.
  for (const std::size_t row : rows) *(around(row) - 8) = 50;
  const Matrix after = model.predict(data, rows);
  for (const std::size_t row : rows) {
    const double moved = foreground_tangent(after.row(row), model.first().scene) -
                         foreground_tangent(before.row(row), model.first().scene);
    INFO(moved);
    CHECK(std::abs(moved) * 3.5 < 0.1);
  }
}

TEST_CASE("the map of an empty room is the background") {
  Dataset dark = plates();
  for (float& v : photons(dark).values) v = 1;
  CHECK(
      std::ranges::equal(trained().predict(dark, {5}).values, trained().first().scene.background));
}

TEST_CASE("training a factorised model requires both sensors and records with bodies") {
  TrainOptions options = quiet_options("factorised");
  options.inputs = "spd";
  CHECK_THROWS_WITH(train(plates(), options), Contains("need both sensors"));
  Dataset empty = plates();
  std::fill(depth_maps(empty).values.begin(), depth_maps(empty).values.end(), 0.f);
  options.inputs = "fused";
  CHECK_THROWS_WITH(train(empty, options), Contains("fewer than two training records"));
}
