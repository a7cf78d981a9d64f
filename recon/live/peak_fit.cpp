// SPDX-License-Identifier: MIT
#include "recon/live/peak_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "acquire/measurement/response.hpp"
#include "drivers/core/median.hpp"

namespace echofuse::view {
namespace {

using record::fwhm_of_sigma;

// Model of a peak at bins i: height * exp(-(i - centre)^2 / 2 sigma^2) + background. The centre and
// sigma are in bins.
struct Gaussian {
  using Parameters = Eigen::Vector4d;  // centre, sigma, height, background
  std::span<const double> values;
  std::ptrdiff_t first, last;
  bool counts;

  // Returns the weighted sum of squared residuals r, and computes J^T W J and J^T W r of the normal
  // equations.
  double normal(const Parameters& p, Eigen::Matrix4d& square, Parameters& slope) const {
    square.setZero(), slope.setZero();
    double sum = 0;
    for (auto i = first; i <= last; ++i) {
      const double u = (static_cast<double>(i) - p[0]) / p[1], bell = std::exp(-u * u / 2);
      const double model = p[2] * bell + p[3];
      const double rest = values[static_cast<std::size_t>(i)] - model;
      const double weight = counts ? 1 / std::max(model, 1.0) : 1.0;
      const Parameters along(p[2] * bell * u / p[1], p[2] * bell * u * u / p[1], bell, 1);
      square += weight * along * along.transpose();
      slope += weight * rest * along;
      sum += weight * rest * rest;
    }
    return sum;
  }
};

}  // namespace

std::optional<PeakFit> fit_peak(std::span<const double> values, const Axis& axis, double from,
                                double to, bool counts) {
  const auto n = static_cast<std::ptrdiff_t>(values.size());
  const auto bin = [&](double x, std::ptrdiff_t otherwise) {
    const double at = (x - axis.start) / axis.step;
    return std::abs(at) < 1e9 ? std::clamp(std::lround(at), 0L, n - 1) : otherwise;
  };
  if (n < 8) return std::nullopt;
  const std::ptrdiff_t begin = bin(from, 0), end = bin(to, n - 1);
  if (end - begin < 4) return std::nullopt;
  const auto at = [&](std::ptrdiff_t i) { return values[static_cast<std::size_t>(i)]; };
  const std::ptrdiff_t top =
      std::max_element(values.begin() + begin, values.begin() + end + 1) - values.begin();
  const double floor = median(std::vector(values.begin(), values.end())),
               half = (at(top) + floor) / 2;
  std::ptrdiff_t left = top, right = top;
  while (left > begin && at(left) > half) --left;
  while (right < end && at(right) > half) ++right;
  const double sigma = std::max(0.6, static_cast<double>(right - left) / 2 / fwhm_of_sigma * 1.2);
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(3.5 * sigma)) + 2;
  const Gaussian model{values, std::max(begin, top - reach), std::min(end, top + reach), counts};
  const auto points = static_cast<double>(model.last - model.first + 1);
  if (points < 5) return std::nullopt;
  Gaussian::Parameters p(static_cast<double>(top), sigma, at(top) - floor, floor), slope, unused;
  Eigen::Matrix4d square, other;
  double damping = 1e-3, sum = model.normal(p, square, slope);
  for (int round = 0; round < 60 && damping < 1e9; ++round) {
    Eigen::Matrix4d damped = square;
    damped.diagonal() *= 1 + damping;
    const Gaussian::Parameters next = p + damped.ldlt().solve(slope);
    const bool inside = next.allFinite() && next[1] > 0.2 && next[1] < points &&
                        next[0] >= static_cast<double>(model.first) &&
                        next[0] <= static_cast<double>(model.last);
    const double after = inside ? model.normal(next, other, unused) : sum;
    if (!inside || after >= sum) {
      damping *= 4;
      continue;
    }
    const bool done = sum - after < 1e-9 * sum;
    p = next, sum = after, square = other, slope = unused, damping /= 5;
    if (done) break;
  }
  // The variance of counts is known (Poisson). The variance of powers is estimated from the
  // residuals.
  const double noise = counts ? 1 : sum / (points - 4);
  const Eigen::Matrix4d covariance = square.inverse() * noise;
  const double height_error = std::sqrt(std::max(covariance(2, 2), 0.0));
  if (!(p[2] > 5 * height_error)) return std::nullopt;
  const double variance = p[1] * p[1] - (counts ? 1.0 / 12 : 0.0);
  return PeakFit{.centre = axis.start + p[0] * axis.step,
                 .centre_error = std::sqrt(std::max(covariance(0, 0), 0.0)) * axis.step,
                 .fwhm = fwhm_of_sigma * std::sqrt(std::max(variance, 0.0)) * axis.step,
                 .height = p[2]};
}

std::size_t bins_before_return(std::span<const double> counts) {
  constexpr std::size_t neighbours = 5, min_bins = 10, margin = 3;
  const auto sum_of = [&](std::size_t first, std::size_t count) {
    const auto bins = counts.subspan(first, count);
    return std::accumulate(bins.begin(), bins.end(), 0.0);
  };
  double sum = sum_of(0, std::min(min_bins, counts.size()));
  for (std::size_t i = min_bins; i + neighbours <= counts.size(); sum += counts[i++]) {
    const double expected = sum / static_cast<double>(i) * neighbours;
    const double here = sum_of(i, neighbours);
    if (here > expected + 5 * std::sqrt(expected) + 5)
      return i > min_bins + margin ? i - margin : 0;
  }
  return counts.size();
}

}  // namespace echofuse::view
