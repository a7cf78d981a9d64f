// SPDX-License-Identifier: MIT
#include "recon/metrics/metrics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "drivers/util/format.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
constexpr double side_threshold_m = 0.3;
constexpr double min_mass = 1;  // minimum number of foreground pixels for a valid position

// Weighted mean of the added values; NaN if no value was added.
struct Mean {
  double sum = 0;
  double weight = 0;
  void add(double value, double w = 1) { sum += w * value, weight += w; }
  double value(double min_weight = 0) const {
    return weight > min_weight ? sum / weight : undefined;
  }
};

Mask true_mask(std::span<const float> truth, const SceneModel& scene) {
  Mask mask(truth.size());
  for (std::size_t p = 0; p < mask.size(); ++p)
    mask[p] = scene.has_body() && true_foreground(truth[p], scene.background[p]);
  return mask;
}

std::size_t mirrored(std::size_t pixel, std::size_t size) {
  return pixel - pixel % size + (size - 1 - pixel % size);
}

Mask found_mask(const std::vector<float>& share) {
  Mask mask(share.size());
  for (std::size_t p = 0; p < mask.size(); ++p) mask[p] = share[p] > 0.5f;
  return mask;
}

// Returns x/z averaged over the foreground pixels.
double centroid_tangent(const Mask& mask, const record::MapGrid& grid) {
  const Axis x = grid.x();
  std::vector<double> of_column(x.count);
  for (std::size_t first = 0; first < mask.size(); first += x.count)
    for (std::size_t c = 0; c < x.count; ++c) of_column[c] += mask[first + c];
  Mean tangent;
  for (std::size_t c = 0; c < x.count; ++c) tangent.add(x.at(static_cast<double>(c)), of_column[c]);
  return tangent.value(min_mass);
}

// Returns the mean of the SSIM map over the mask, dilated by the 11 x 11 window.
double ssim_near(const std::vector<double>& map, const Mask& mask, std::size_t size) {
  const std::size_t inner = size - 2 * ssim_border, window = 2 * ssim_border + 1;
  std::vector<char> across(size * inner);
  for (std::size_t i = 0; i < across.size(); ++i) {
    const auto first = mask.begin() + static_cast<std::ptrdiff_t>(i / inner * size + i % inner);
    across[i] = std::find(first, first + window, 1) != first + window;
  }
  Mean mean;
  for (std::size_t i = 0; i < map.size(); ++i)
    for (std::size_t r = 0; r < window; ++r)
      if (across[i + r * inner]) {
        mean.add(map[i]);
        break;
      }
  return mean.value();
}

void score_similarity(MapScores& out, std::span<const float> raw, std::span<const float> truth,
                      const SceneModel& scene, const Mask& mask) {
  const std::size_t size = scene.grid.size;
  if (size <= 2 * ssim_border) return;
  const auto map = ssim_map(raw, truth, size, scene.grid.far_m);
  out[metric_ssim] = out[metric_ssim_hard] = mean_of(map);
  out[metric_ssim_fg] = ssim_near(map, mask, size);
  if (const auto hard = thresholded_map(raw, scene); !std::ranges::equal(hard, raw))
    out[metric_ssim_hard] = mean_of(ssim_map(hard, truth, size, scene.grid.far_m));
}

void score_pixels(MapScores& out, std::span<const float> raw, std::span<const float> truth,
                  const Mask& mask, const Mask& found) {
  Mean all, foreground, common, relative, close, overlap;
  for (std::size_t p = 0; p < truth.size(); ++p) {
    const double v = raw[p], d = truth[p], error = v - d;
    const bool predicted = found[p];
    all.add(error * error);
    if (mask[p]) foreground.add(error * error);
    if (mask[p] && predicted) common.add(std::abs(error));
    if (mask[p] || predicted) overlap.add(mask[p] && predicted);
    if (d <= 0) continue;
    relative.add(std::abs(error) / d);
    close.add(v > 0 && std::max(v / d, d / v) < 1.25);
  }
  out[metric_iou] = overlap.value();
  out[metric_rmse_m] = std::sqrt(all.value());
  out[metric_rmse_fg_m] = std::sqrt(foreground.value());
  out[metric_depth_mae_m] = common.value();
  out[metric_abs_rel] = relative.value();
  out[metric_delta_125] = close.value();
}

void score_position(MapScores& out, std::span<const float> truth, const Mask& mask,
                    const std::vector<float>& share, const Mask& found,
                    const record::MapGrid& grid) {
  Mean range, ghost;
  for (std::size_t p = 0; p < truth.size(); ++p) {
    const bool here = mask[p], there = mask[mirrored(p, grid.size)];
    if (here) range.add(truth[p]);
    if (here != there) ghost.add(there, double{share[p]});
  }
  const double true_tangent = centroid_tangent(mask, grid);
  const double tangent = centroid_tangent(found, grid);
  const bool to_a_side = std::abs(true_tangent) * range.value() > side_threshold_m;
  const bool right_side = (tangent > 0) == (true_tangent > 0);
  out[metric_lateral_m] = std::abs(tangent - true_tangent) * range.value();
  out[metric_ghost] = to_a_side ? ghost.value(min_mass) : undefined;
  out[metric_left_right] = to_a_side && !std::isnan(tangent) ? right_side : undefined;
}

}  // namespace

MapScores score(std::span<const float> prediction, std::span<const float> truth,
                const SceneModel& scene) {
  MapScores out;
  out.fill(undefined);
  const Mask mask = true_mask(truth, scene);
  const auto raw = within_span(prediction, scene);
  const auto share = foreground_share(raw, scene);
  const Mask found = found_mask(share);
  score_similarity(out, raw, truth, scene, mask);
  score_pixels(out, raw, truth, mask, found);
  score_position(out, truth, mask, share, found, scene.grid);
  return out;
}

double foreground_tangent(std::span<const float> prediction, const SceneModel& scene) {
  return centroid_tangent(found_mask(foreground_share(within_span(prediction, scene), scene)),
                          scene.grid);
}

BodyPlace body_place(std::span<const float> prediction, const SceneModel& scene) {
  const auto map = within_span(prediction, scene);
  const Mask found = found_mask(foreground_share(map, scene));
  Mean z;
  for (std::size_t p = 0; p < found.size(); ++p)
    if (found[p]) z.add(map[p]);
  const double z_m = z.value(min_mass);
  return {centroid_tangent(found, scene.grid) * z_m, z_m};
}

double lateral_error(std::span<const float> prediction, std::span<const float> truth,
                     const SceneModel& scene) {
  MapScores out;
  const auto share = foreground_share(within_span(prediction, scene), scene);
  score_position(out, truth, true_mask(truth, scene), share, found_mask(share), scene.grid);
  return out[metric_lateral_m];
}

Summaries summarise(const std::vector<MapScores>& scores) {
  Summaries out;
  for (std::size_t m = 0; m < metric_count; ++m) {
    Mean mean, square;
    for (const auto& s : scores)
      if (!std::isnan(s[m])) mean.add(s[m]);
    for (const auto& s : scores)
      if (!std::isnan(s[m])) square.add((s[m] - mean.value()) * (s[m] - mean.value()));
    const double n = mean.weight;
    out[m] = {mean.value(), n > 1 ? std::sqrt(square.sum / (n - 1) / n) : undefined,
              static_cast<std::size_t>(n)};
  }
  return out;
}

std::string formatted(const Summary& s, const char* plus_minus) {
  if (std::isnan(s.mean)) return "-";
  if (std::isnan(s.se)) return format("%.3f", s.mean);
  return format("%.3f", s.mean) + plus_minus + format("%.3f", s.se);
}

namespace {

constexpr int border = ssim_border;

cv::Mat1d image_of(std::span<const float> values, std::size_t size) {
  cv::Mat1d out(static_cast<int>(size), static_cast<int>(size));
  std::copy(values.begin(), values.end(), out.begin());
  return out;
}

// Returns Gaussian-weighted means for all pixels with a complete window.
cv::Mat1d blur(const cv::Mat& image) {
  cv::Mat1d out;
  cv::GaussianBlur(image, out, {2 * border + 1, 2 * border + 1}, 1.5);
  return out(cv::Rect(border, border, image.cols - 2 * border, image.rows - 2 * border)).clone();
}

}  // namespace

std::vector<double> ssim_map(std::span<const float> a, std::span<const float> b, std::size_t size,
                             double data_range) {
  const cv::Mat1d image_a = image_of(a, size), image_b = image_of(b, size);
  const cv::Mat1d mean_a = blur(image_a), mean_b = blur(image_b), aa = blur(image_a.mul(image_a)),
                  bb = blur(image_b.mul(image_b)), ab = blur(image_a.mul(image_b));
  const double c1 = std::pow(0.01 * data_range, 2), c2 = std::pow(0.03 * data_range, 2);
  std::vector<double> out;
  out.reserve(ab.total());
  for (int i = 0; i < static_cast<int>(ab.total()); ++i) {
    const double ma = mean_a(i), mb = mean_b(i);
    const double var_a = aa(i) - ma * ma, var_b = bb(i) - mb * mb, cov = ab(i) - ma * mb;
    out.push_back((2 * ma * mb + c1) * (2 * cov + c2) /
                  ((ma * ma + mb * mb + c1) * (var_a + var_b + c2)));
  }
  return out;
}

}  // namespace echofuse::recon
