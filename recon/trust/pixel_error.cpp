// SPDX-License-Identifier: MIT
#include "recon/trust/pixel_error.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "acquire/measurement/depth_map.hpp"

namespace echofuse::recon {
namespace {

struct CurvePosition {
  std::size_t low;
  double part;
};

// Returns the position of a probability between the nodes of a curve.
CurvePosition node_of(double share, std::size_t nodes) {
  const double at = std::clamp(share, 0.0, 1.0) * static_cast<double>(nodes - 1);
  const auto low = std::min(static_cast<std::size_t>(at), nodes - 2);
  return {low, at - static_cast<double>(low)};
}

SoftMaps probabilities_of(const Matrix& maps, const SceneModel& scene) {
  SoftMaps out{Matrix(0, maps.cols), Matrix(maps.rows, maps.cols)};
  for (std::size_t i = 0; i < maps.rows; ++i)
    out.foreground_probability.add_row(foreground_share(maps.row(i), scene));
  for (float& v : out.foreground_probability.values)
    v = scene.has_body() ? std::clamp(v, 0.f, 1.f) : 1;
  std::fill(out.depth.values.begin(), out.depth.values.end(), scene.foreground_depth_m);
  // If the scene has no body, the whole map counts as foreground.
  if (!scene.has_body()) out.depth = maps;
  return out;
}

// Blurs each map of foreground probabilities horizontally. The standard deviation of map i is
// deviation_m[i], converted to pixels at the depth of the central pixel.
void blur(SoftMaps& maps, const record::MapGrid& grid, const std::vector<double>& deviation_m) {
  constexpr double min_pixels = 0.2;
  const auto side = static_cast<int>(grid.size);
  for (std::size_t i = 0; i < maps.foreground_probability.rows; ++i) {
    const double depth_m = std::max(double{maps.depth.row(i)[maps.depth.cols / 2]}, 0.1);
    const double pixels = std::min(deviation_m[i] / depth_m / grid.step(), double(side));
    if (!(pixels > min_pixels)) continue;
    cv::Mat1f share(side, side, maps.foreground_probability.row(i).data());
    const int reach = static_cast<int>(std::ceil(3 * pixels));
    cv::GaussianBlur(share, share, {2 * reach + 1, 1}, pixels, 1, cv::BORDER_CONSTANT);
  }
}

}  // namespace

SoftMaps soft_of(SoftMaps own, const Matrix& maps, const SceneModel& scene,
                 const std::vector<double>& lateral_interval_90_m) {
  // 95 % quantile of the normal distribution, because each tail contains 5 %
  constexpr double deviations_90 = 1.645;
  if (own.foreground_probability.rows == 0 || !scene.has_body())
    return probabilities_of(maps, scene);
  std::vector<double> deviation_m = lateral_interval_90_m;
  for (double& d : deviation_m) d /= deviations_90;
  blur(own, scene.grid, deviation_m);
  return own;
}

void PixelError::fit(const SoftMaps& soft, const Matrix& truth, const SceneModel& scene) {
  std::array<double, 11> weight{}, body{};
  double squares = 0, count = 0;
  for (std::size_t i = 0; i < truth.rows; ++i) {
    const auto share = soft.foreground_probability.row(i), depth = soft.depth.row(i),
               map = truth.row(i);
    for (std::size_t p = 0; p < map.size(); ++p) {
      const CurvePosition at = node_of(double{share[p]}, curve_.size());
      const bool is_body = !scene.has_body() || true_foreground(map[p], scene.background[p]);
      weight[at.low] += 1 - at.part, weight[at.low + 1] += at.part;
      body[at.low] += is_body * (1 - at.part), body[at.low + 1] += is_body * at.part;
      if (!is_body || share[p] < 0.5f) continue;
      squares += std::pow(double{map[p]} - double{depth[p]}, 2), ++count;
    }
  }
  double below = 0;  // running maximum, because the curve must not decrease
  for (std::size_t k = 0; k < curve_.size(); ++k)
    below = curve_[k] = std::max(below, weight[k] > 0 ? body[k] / weight[k] : 0);
  depth_deviation_m_ = count > 0 ? std::sqrt(squares / count) : 0;
}

std::pair<Matrix, Matrix> PixelError::operator()(const SoftMaps& soft,
                                                 const SceneModel& scene) const {
  const std::size_t rows = soft.foreground_probability.rows,
                    cols = soft.foreground_probability.cols;
  Matrix mean(rows, cols), deviation(rows, cols);
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t p = 0; p < cols; ++p) {
      const CurvePosition at =
          node_of(double{soft.foreground_probability.row(i)[p]}, curve_.size());
      const double body = curve_[at.low] + at.part * (curve_[at.low + 1] - curve_[at.low]);
      const double b = double{scene.background[p]}, z = double{soft.depth.row(i)[p]};
      mean.row(i)[p] = static_cast<float>(body * z + (1 - body) * b);
      deviation.row(i)[p] = static_cast<float>(std::sqrt(
          body * (1 - body) * (z - b) * (z - b) + body * depth_deviation_m_ * depth_deviation_m_));
    }
  return {std::move(mean), std::move(deviation)};
}

void PixelError::archive(Archive archive) {
  std::vector<double> curve(curve_.begin(), curve_.end());
  archive.values("curve", curve, curve_.size());
  archive.require(
      std::all_of(curve.begin(), curve.end(), [](double s) { return s >= 0 && s <= 1; }), "curve",
      "expected values from 0 to 1");
  std::copy(curve.begin(), curve.end(), curve_.begin());
  archive.number("depth_deviation_m", depth_deviation_m_, 0, record::max_map_far_m);
}

}  // namespace echofuse::recon
