// SPDX-License-Identifier: MIT
// Metrics of depth maps. Each metric is computed for each map, and then averaged over the maps with
// its standard error.
#pragma once
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "recon/metrics/scene_model.hpp"

namespace echofuse::recon {

// Structural similarity of two depth maps (Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13, 600,
// 2004), with an 11 x 11 Gaussian window of sigma 1.5, K1 = 0.01, K2 = 0.03 and the population
// covariance. Pixels closer to the border than this have no complete window and are excluded.
inline constexpr std::size_t ssim_border = 5;

// Returns the SSIM of two maps of size x size pixels, for each pixel with a complete window:
// (size-10)^2 values, row-major. `size` must exceed 10. `data_range`: difference between the
// largest and the smallest value that any map can contain (e.g. 6 m), not the range found in these
// two maps.
std::vector<double> ssim_map(std::span<const float> a, std::span<const float> b, std::size_t size,
                             double data_range);

// "raw" metrics use the prediction, clipped to the depths of the grid. "hard" metrics use the
// thresholded map (scene_model.hpp). A metric is NaN if it is undefined for a map, e.g. the depth
// error of an empty mask, and the map is then excluded from the mean. If the scene has no
// foreground, only the metrics of raw maps are defined.
enum Metric : std::size_t {
  metric_iou,          // IoU of the foreground masks; undefined if both are empty
  metric_ssim,         // raw; mean SSIM over the map, with the data range of the grid
  metric_ssim_hard,    // hard; mean SSIM over the map
  metric_ssim_fg,      // raw; mean SSIM over the true foreground, dilated by 11 x 11 pixels
  metric_rmse_m,       // raw
  metric_rmse_fg_m,    // raw; RMS error over the ground-truth foreground, m
  metric_depth_mae_m,  // raw; mean absolute error where true and predicted foreground overlap, m
  metric_abs_rel,      // raw; mean of |v - d| / d over pixels with d > 0 (v predicted, d true)
  metric_delta_125,    // raw; fraction of pixels with max(v/d, d/v) < 1.25 (v predicted, d true)
  metric_lateral_m,    // difference between the centroids' x/z, times the true mean depth, m
  // The next two metrics are undefined if |x| <= 0.3 m, because a body near the axis overlaps its
  // mirror image.
  metric_ghost,       // raw; fraction of the predicted foreground at the mirror image of the body
  metric_left_right,  // 1 if the foreground centroid is on the correct side (left, right), else 0
  metric_count
};
inline constexpr std::array<const char*, metric_count> metric_names = {
    "iou",         "ssim",    "ssim_hard", "ssim_fg",   "rmse_m", "rmse_fg_m",
    "depth_mae_m", "abs_rel", "delta_125", "lateral_m", "ghost",  "left_right"};
static_assert(metric_names.back() != nullptr);  // fails if a metric has no name

using MapScores = std::array<double, metric_count>;

// Computes all metrics of one map. Both maps are row-major on the grid of the scene, in metres.
MapScores score(std::span<const float> prediction, std::span<const float> truth,
                const SceneModel& scene);

// Returns x/z of the centroid of the predicted foreground; NaN if the foreground is empty.
double foreground_tangent(std::span<const float> prediction, const SceneModel& scene);

// Position of the body in a predicted map, m. x points to the right, and z points away from the
// detector. NaN if the map contains no body.
struct BodyPlace {
  double x_m, z_m;
};
BodyPlace body_place(std::span<const float> prediction, const SceneModel& scene);

// Computes only metric_lateral_m.
double lateral_error(std::span<const float> prediction, std::span<const float> truth,
                     const SceneModel& scene);

struct Summary {
  double mean = 0;       // mean of the metric; NaN if it is undefined for all maps
  double se = 0;         // standard error of the mean; NaN for fewer than two maps
  std::size_t maps = 0;  // number of maps for which the metric is defined
};
using Summaries = std::array<Summary, metric_count>;
Summaries summarise(const std::vector<MapScores>& scores);
// Formats the mean and its standard error, e.g. "0.483 ± 0.005", with `plus_minus` between the two
// numbers. Returns "-" if the mean is NaN.
std::string formatted(const Summary& summary, const char* plus_minus);

}  // namespace echofuse::recon
