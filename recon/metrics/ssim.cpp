// SPDX-License-Identifier: MIT
#include "recon/metrics/ssim.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace echofuse::recon {
namespace {

constexpr std::size_t taps = 2 * ssim_border + 1;

std::array<double, taps> gaussian() {
  std::array<double, taps> g{};
  double sum = 0;
  for (std::size_t i = 0; i < taps; ++i) {
    const double x = static_cast<double>(i) - ssim_border;
    sum += g[i] = std::exp(-x * x / (2 * 1.5 * 1.5));
  }
  for (double& v : g) v /= sum;
  return g;
}

// For each of `count` neighbours it computes the mean over `taps` values that are `stride` apart.
// It takes some neighbours at a time; their sums stay in registers.
void weigh(const double* in, std::size_t stride, std::size_t count, double* out) {
  static const auto g = gaussian();
  constexpr std::size_t at_once = 8;
  std::size_t c = 0;
  for (; c + at_once <= count; c += at_once) {
    std::array<double, at_once> sum{};
    for (std::size_t t = 0; t < taps; ++t)
      for (std::size_t k = 0; k < at_once; ++k) sum[k] += g[t] * in[t * stride + c + k];
    std::copy(sum.begin(), sum.end(), out + c);
  }
  for (; c < count; ++c) {
    double sum = 0;
    for (std::size_t t = 0; t < taps; ++t) sum += g[t] * in[t * stride + c];
    out[c] = sum;
  }
}

// These are windowed means of a size x size image at the pixels whose window lies inside: first
// along rows, then along columns.
std::vector<double> blur(const std::vector<double>& image, std::size_t size) {
  const std::size_t inner = size - 2 * ssim_border;
  std::vector<double> wide(size * inner), out(inner * inner);
  for (std::size_t r = 0; r < size; ++r) weigh(&image[r * size], 1, inner, &wide[r * inner]);
  for (std::size_t r = 0; r < inner; ++r) weigh(&wide[r * inner], inner, inner, &out[r * inner]);
  return out;
}

std::vector<double> product(std::span<const float> a, std::span<const float> b) {
  std::vector<double> out(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) out[i] = double{a[i]} * double{b[i]};
  return out;
}

}  // namespace

std::vector<double> ssim_map(std::span<const float> a, std::span<const float> b, std::size_t size,
                             double data_range) {
  const auto mean_a = blur({a.begin(), a.end()}, size), mean_b = blur({b.begin(), b.end()}, size);
  const auto aa = blur(product(a, a), size), bb = blur(product(b, b), size);
  const auto ab = blur(product(a, b), size);
  const double c1 = std::pow(0.01 * data_range, 2), c2 = std::pow(0.03 * data_range, 2);
  std::vector<double> out(ab.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double ma = mean_a[i], mb = mean_b[i];
    const double var_a = aa[i] - ma * ma, var_b = bb[i] - mb * mb, cov = ab[i] - ma * mb;
    out[i] =
        (2 * ma * mb + c1) * (2 * cov + c2) / ((ma * ma + mb * mb + c1) * (var_a + var_b + c2));
  }
  return out;
}

}  // namespace echofuse::recon
