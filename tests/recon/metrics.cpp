// SPDX-License-Identifier: MIT
// Compares the scores of simple maps with values computed by hand.
#include "recon/metrics/metrics.hpp"

#include "../catch.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "drivers/core/random.hpp"
#include "recon/trust/pixel_error.hpp"

using namespace echofuse::recon;

namespace {

constexpr std::size_t size = 64;
using Map = std::vector<float>;

// Returns a map of a plate in front of a background. The plate covers columns [left, left + 10) and
// rows 20 to 43.
Map plate(std::size_t left, float depth_m, float background_m = 0) {
  Map out(size * size, background_m);
  for (std::size_t r = 20; r < 44; ++r)
    for (std::size_t c = left; c < left + 10; ++c) out[r * size + c] = depth_m;
  return out;
}
Map mirrored(const Map& map) {
  Map out(map.size());
  for (std::size_t p = 0; p < map.size(); ++p) out[p - p % size + (size - 1 - p % size)] = map[p];
  return out;
}
Map average(const Map& a, const Map& b) {
  Map out(a.size());
  for (std::size_t p = 0; p < out.size(); ++p) out[p] = (a[p] + b[p]) / 2;
  return out;
}
// Adds noise to the rows above the plate. The noise resembles that in maps predicted by a
// regression model.
Map with_ripple(Map map) {
  for (std::size_t p = 0; p < size * 20; ++p) map[p] = 0.05f;
  return map;
}
SceneModel room(float background_m = 0, float foreground_m = 3.5f) {
  return {Map(size * size, background_m), Map(size * size, background_m), foreground_m, {}};
}

}  // namespace

TEST_CASE("a perfect prediction has perfect scores") {
  const Map truth = plate(6, 3.4f);
  const MapScores s = score(truth, truth, room());
  for (const Metric one : {metric_iou, metric_ssim, metric_ssim_hard, metric_ssim_fg,
                           metric_delta_125, metric_left_right})
    CHECK(s[one] == Approx(1).epsilon(1e-12));
  for (const Metric zero :
       {metric_rmse_m, metric_rmse_fg_m, metric_depth_mae_m, metric_abs_rel, metric_ghost})
    CHECK(s[zero] == 0);
  CHECK(s[metric_lateral_m] == Approx(0).margin(1e-12));
}

TEST_CASE("the ghost score is 1 for the mirror image of a body and 0.5 for the mean of the two") {
  const Map truth = plate(6, 3.5f), ghost = mirrored(truth);
  const MapScores wrong = score(ghost, truth, room());
  CHECK((wrong[metric_ghost] == 1 && wrong[metric_left_right] == 0 && wrong[metric_iou] == 0));
  CHECK(std::isnan(wrong[metric_depth_mae_m]));
  // The lateral error is the distance between the object and its mirror image. It is twice the
  // tangent of the centroid, times 3.5 m.
  const double tangent = record::MapGrid{}.x().at(6 + 4.5);
  CHECK(wrong[metric_lateral_m] == Approx(2 * std::abs(tangent) * 3.5).epsilon(1e-9));
  const MapScores both = score(with_ripple(average(truth, ghost)), truth, room());
  CHECK(both[metric_ghost] == Approx(0.5).epsilon(1e-12));
  // In the mean of the map and its mirror image, the object has half its depth, which is below the
  // foreground threshold.
  CHECK(std::isnan(both[metric_lateral_m]));
}

TEST_CASE("body position is the foreground centroid after clipping the map to valid depths") {
  const Map truth = plate(6, 3.5f);
  Map ripple = truth;
  // Negative depths are clipped to 0.
  for (std::size_t p = 40; p < 60; ++p) ripple[p] = -30;
  // Depths of 0.4 m do not count as foreground.
  for (std::size_t p = 64 * 60; p < 64 * 64; ++p) ripple[p] = 0.4f;
  const MapScores s = score(ripple, truth, room());
  CHECK(s[metric_lateral_m] == Approx(0).margin(1e-12));
  CHECK(s[metric_ghost] == 0);
  CHECK(lateral_error(ripple, truth, room()) == s[metric_lateral_m]);
  // A depth beyond the map grid's largest depth is scored as if it were that largest depth.
  SceneModel far = room();
  far.grid.far_m = 10;
  CHECK(score(plate(6, 30), truth, far)[metric_depth_mae_m] == Approx(6.5));
  CHECK(score(plate(6, 30), truth, room())[metric_depth_mae_m] == Approx(2.5));
}

TEST_CASE("position scores are undefined for an empty map or a body near the optical axis") {
  // The centre of the plate is at column 32.5, which is only 3 cm from the optical axis.
  const Map middle = plate(28, 3.5f);
  const MapScores s = score(mirrored(middle), middle, room()),
                  none = score(Map(size * size), plate(6, 3.5f), room());
  for (const double undefined : {s[metric_ghost], s[metric_left_right], none[metric_ghost],
                                 none[metric_left_right], none[metric_lateral_m]})
    CHECK(std::isnan(undefined));
}

TEST_CASE("a plate predicted at the wrong position and distance has the expected scores") {
  const Map truth = plate(10, 3.5f), prediction = plate(15, 3.0f);
  const MapScores s = score(prediction, truth, room());
  CHECK(s[metric_iou] == Approx(5.0 / 15));
  CHECK(s[metric_depth_mae_m] == Approx(0.5));
  const double pixels = 24 * 5;
  const double squares = pixels * (3.5 * 3.5 + 0.5 * 0.5 + 3.0 * 3.0);
  CHECK(s[metric_rmse_m] == Approx(std::sqrt(squares / (size * size))));
  CHECK(s[metric_rmse_fg_m] == Approx(std::sqrt((3.5 * 3.5 + 0.5 * 0.5) / 2)));
  CHECK(s[metric_abs_rel] == Approx((1 + 0.5 / 3.5) / 2));
  // The plate's visible half counts as correct, because 3.5 / 3.0 < 1.25. The missed half counts as
  // wrong.
  CHECK(s[metric_delta_125] == Approx(0.5));
}

TEST_CASE("if no background is known, every return of a ground-truth map is foreground") {
  // Predicted depths are foreground above half the mean body depth.
  const Map truth = plate(10, 3.5f);
  CHECK(score(with_ripple(plate(10, 1.76f)), truth, room())[metric_iou] == 1);
  CHECK(std::isnan(score(with_ripple(plate(10, 1.74f)), truth, room())[metric_lateral_m]));
  for (const float depth_m : {0.6f, 1.2f, 1.4f, 1.74f, 5.5f}) {
    const Map near = plate(10, depth_m);
    CHECK(score(near, near, room())[metric_iou] == 1);
    CHECK(thresholded_map(near, room()) == near);
  }
  // The first map shows two objects, one behind the other. The second map shows a near object that
  // fills the field of view.
  Map two = plate(6, 1.2f);
  const Map behind = plate(30, 5.2f), all(size * size, 1.3f);
  for (std::size_t p = 0; p < two.size(); ++p) two[p] += behind[p];
  CHECK(score(two, two, room())[metric_iou] == 1);
  CHECK(score(all, all, room())[metric_iou] == 1);
}

TEST_CASE("pixels near the background depth are not foreground") {
  const SceneModel scene = room(5.5f, 3.5f);
  const Map truth = plate(10, 3.5f, 5.5f), empty(size * size, 5.5f);
  CHECK(score(truth, truth, scene)[metric_iou] == 1);
  CHECK(score(empty, truth, scene)[metric_iou] == 0);
  CHECK(score(plate(10, 4.4f, 5.5f), truth, scene)[metric_iou] == 1);
  CHECK(score(plate(10, 4.6f, 5.5f), truth, scene)[metric_iou] == 0);
  CHECK(thresholded_map(plate(10, 4.6f, 5.5f), scene) == empty);
  CHECK(std::isnan(score(empty, empty, scene)[metric_iou]));
  CHECK_FALSE(true_foreground(5.45f, 5.5f));
  // A depth of 0 means that no light returned, so it is unknown whether there is a surface.
  CHECK_FALSE(true_foreground(0, 5.5f));
}

TEST_CASE("foreground depth and background are learnt from the training maps") {
  Matrix maps(0, size * size);
  for (const std::size_t left : {2u, 20u, 50u}) maps.add_row(plate(left, 3.2f, 5.0f));
  const SceneModel scene = learn_scene(maps, {0, 1, 2}, {});
  CHECK(scene.background == Map(size * size, 5.0f));
  CHECK(scene.foreground_depth_m == Approx(3.2f));
  CHECK(scene.mean_map[30 * size + 2] == Approx((3.2 + 5 + 5) / 3));
  // A pixel has a background depth if fewer than 20 % of the maps lack a depth at that pixel. The
  // fraction is 19 % for pixel 0 and 20 % for pixel 1.
  Matrix holes(0, size * size);
  Rows rows;
  for (std::size_t i = 0; i < 100; ++i) {
    Map map(size * size, 5.0f);
    if (i < 19) map[0] = 0;
    if (i < 20) map[1] = 0;
    holes.add_row(map), rows.push_back(i);
  }
  const Map background = learn_scene(holes, rows, {}).background;
  CHECK(background[0] == 5);
  CHECK(background[1] == 0);
}

TEST_CASE("foreground scores are undefined if a moving surface replaces the background") {
  Rng rng = make_rng(3, 3);
  // In a third of the maps, the wall is at 2.9 m. In the other maps, its distance is random between
  // `nearest` and 3 m.
  for (const float nearest : {0.5f, 1.8f}) {
    Matrix walls(0, size * size);
    std::uniform_real_distribution<float> z(nearest, 3);
    for (int i = 0; i < 160; ++i) walls.add_row(Map(size * size, i % 3 ? z(rng) : 2.9f));
    const SceneModel scene = learn_scene(walls, all_rows(160), {});
    CHECK_FALSE(scene.has_body());
    const Map truth(size * size, 1.5f), off(size * size, 1.62f);
    const MapScores s = score(off, truth, scene);
    for (const Metric none : {metric_iou, metric_ssim_fg, metric_rmse_fg_m, metric_depth_mae_m,
                              metric_lateral_m, metric_ghost, metric_left_right})
      CHECK(std::isnan(s[none]));
    CHECK(s[metric_rmse_m] == Approx(0.12));
    CHECK(s[metric_ssim] == s[metric_ssim_hard]);
    CHECK(thresholded_map(off, scene) == off);
  }
  // The maps show a swinging door leaf that covers the left half of the field of view.
  Matrix leaf(60, size * size);
  for (std::size_t p = 0; p < leaf.values.size(); ++p) {
    const auto map = static_cast<float>(p / leaf.cols), column = static_cast<float>(p % size);
    leaf.values[p] = column < 32 ? 2 + 0.03f * map * (1 + column / 32) : 4;
  }
  CHECK_FALSE(learn_scene(leaf, all_rows(60), {}).has_body());
}

TEST_CASE("the mean and the standard error of scores exclude undefined scores") {
  MapScores a{}, b{}, c{};
  a[metric_iou] = 1, b[metric_iou] = 3, c[metric_iou] = std::nan("");
  const Summaries s = summarise({a, b, c});
  CHECK(s[metric_iou].maps == 2);
  CHECK(s[metric_iou].mean == 2);
  // The standard error of the values 1 and 3 is sqrt(((1 - 2)^2 + (3 - 2)^2) / (2 - 1) / 2).
  CHECK(s[metric_iou].se == Approx(1));
  CHECK(std::isnan(summarise({c})[metric_iou].mean));
  CHECK(std::isnan(summarise({a})[metric_iou].se));
}

TEST_CASE("the foreground probability is blurred at body edges by the position uncertainty") {
  const SceneModel scene = room(5.5f, 3.5f);
  const std::size_t side = scene.grid.size, middle = side / 2;
  SoftMaps own{Matrix(3, side * side), Matrix(3, side * side)};
  std::ranges::fill(own.depth.values, 3.f);
  for (std::size_t p = 0; p < own.foreground_probability.values.size(); ++p)
    own.foreground_probability.values[p] = p % side >= middle;
  // The standard deviations of the position are 4, 0.5 and 0.1 pixels of 3 m times the step.
  std::vector<double> interval_90_m;
  for (const double pixels : {4., 0.5, 0.1})
    interval_90_m.push_back(1.645 * pixels * 3 * scene.grid.step());
  const SoftMaps soft = soft_of(own, Matrix(3, side * side), scene, interval_90_m);
  const auto share = [&](std::size_t map, std::size_t column) {
    return double{soft.foreground_probability.row(map)[middle * side + column]};
  };
  const auto normal = [](double u) { return 0.5 * std::erfc(-u / std::sqrt(2.)); };
  for (const int k : {-8, -5, -1, 0, 3, 7}) {
    CAPTURE(k);
    CHECK(share(0, middle + static_cast<std::size_t>(k)) ==
          Approx(normal((k + 0.5) / 4)).margin(0.01));
  }
  // The blur has a standard deviation of half a pixel. The pixel's centre is half a pixel inside
  // the edge. The tolerance covers the sampling of the edge by pixels.
  CHECK(share(1, middle) == Approx(normal(1)).margin(0.06));
  CHECK(share(2, middle) == 1);
}
