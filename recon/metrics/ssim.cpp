// SPDX-License-Identifier: MIT
#include "recon/metrics/ssim.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace echofuse::recon {
namespace {

constexpr int border = ssim_border;

cv::Mat1d image_of(std::span<const float> values, std::size_t size) {
  cv::Mat1d out(static_cast<int>(size), static_cast<int>(size));
  std::copy(values.begin(), values.end(), out.begin());
  return out;
}

// Windowed means at the pixels whose window lies inside.
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
