// SPDX-License-Identifier: MIT
// Metrics of depth maps: one number for each map and metric, then mean and standard error over
// maps.
#pragma once
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "recon/metrics/scene_model.hpp"

namespace echofuse::recon {

// Structural similarity of two depth maps (Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13, 600, 2004)
// with an 11 x 11 Gaussian window of sigma 1.5, K1 0.01, K2 0.03, population covariance.
inline constexpr std::size_t ssim_border = 5;  // half the window: pixels cropped on each side

// Returns SSIM at each pixel of two size x size maps with a complete window: (size-10)^2 values,
// row-major; size > 10. `data_range` is the span of possible values (6 m), not of the actual ones.
std::vector<double> ssim_map(std::span<const float> a, std::span<const float> b, std::size_t size,
                             double data_range);

// "raw": the prediction clipped to the grid's depths, as it is written. "hard": the thresholded map
// (scene_model.hpp). A metric that is undefined for a map (e.g. the depth error of an empty mask)
// is NaN and left out of the mean. Without a foreground only the metrics of raw maps are defined.
enum Metric : std::size_t {
  metric_iou,          // foreground masks; undefined if both are empty
  metric_ssim,         // raw, whole map, data range of the grid
  metric_ssim_hard,    // hard, whole map
  metric_ssim_fg,      // raw, mean over the true foreground dilated by 11 x 11
  metric_rmse_m,       // raw
  metric_rmse_fg_m,    // raw, over the true foreground
  metric_depth_mae_m,  // raw, over the intersection of both foregrounds
  metric_abs_rel,      // raw, mean |error|/truth over pixels with a true return
  metric_delta_125,    // raw, share of those with max(v/d, d/v) < 1.25
  metric_lateral_m,    // |x/z| between the centroids of both foregrounds, times the true mean z (m)
  // The next two need |x| > 0.3 m, because a body on the axis is its own mirror
  // image.
  metric_ghost,  // raw; 0: at the true position only; 0.5: equal on both sides; 1: mirror image
  metric_left_right,  // 1 if the foreground's centroid is on the true side
  metric_count
};
inline constexpr std::array<const char*, metric_count> metric_names = {
    "iou",         "ssim",    "ssim_hard", "ssim_fg",   "rmse_m", "rmse_fg_m",
    "depth_mae_m", "abs_rel", "delta_125", "lateral_m", "ghost",  "left_right"};
static_assert(metric_names.back() != nullptr);  // each metric has a name

using MapScores = std::array<double, metric_count>;

// Both maps are row-major on the scene's grid, in metres.
MapScores score(std::span<const float> prediction, std::span<const float> truth,
                const SceneModel& scene);

// Centroid of the predicted foreground as x/z; NaN without foreground.
double foreground_tangent(std::span<const float> prediction, const SceneModel& scene);

// Body position in a prediction, m: x to the right, z away. NaN if it shows no body.
struct BodyPlace {
  double x_m, z_m;
};
BodyPlace body_place(std::span<const float> prediction, const SceneModel& scene);

// Computes metric_lateral_m alone.
double lateral_error(std::span<const float> prediction, std::span<const float> truth,
                     const SceneModel& scene);

struct Summary {
  double mean = 0;       // NaN if no map defines the metric
  double se = 0;         // standard error of the mean; NaN for fewer than two maps
  std::size_t maps = 0;  // maps that define it
};
using Summaries = std::array<Summary, metric_count>;
Summaries summarise(const std::vector<MapScores>& scores);
// Returns "0.483 ± 0.005", or "-" if no map defines the metric; `plus_minus` is between.
std::string formatted(const Summary& summary, const char* plus_minus);

}  // namespace echofuse::recon
