// SPDX-License-Identifier: MIT
#include "recon/data/shift.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>

#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

double sinc(double x) {
  if (x == std::round(x)) return x == 0 ? 1 : 0;
  return std::sin(std::numbers::pi * x) / (std::numbers::pi * x);
}

}  // namespace

// Clips the shift to +-1e9 steps, because such a shift already moves all values off the axis.
Shift::Shift(double steps) {
  steps = std::clamp(steps, -1e9, 1e9);
  whole_ = static_cast<std::ptrdiff_t>(std::floor(steps));
  constexpr double half = 4;
  const double part = steps - std::floor(steps);
  for (std::size_t k = 0; k < weights_.size(); ++k) {
    const double x = static_cast<double>(k) - (half - 1) - part;
    weights_[k] = static_cast<float>(sinc(x) * sinc(x / half));
  }
  const float sum = std::accumulate(weights_.begin(), weights_.end(), 0.f);
  for (float& w : weights_) w /= sum;
}

std::vector<float> Shift::apply(const std::vector<float>& values) const {
  if (all_same(values)) return values;
  std::vector<float> out(values.size());
  const auto count = static_cast<std::ptrdiff_t>(values.size());
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const std::ptrdiff_t first = i + whole_ - 3;
    for (std::ptrdiff_t k = 0; k < 8; ++k)
      if (first + k >= 0 && first + k < count)
        out[static_cast<std::size_t>(i)] +=
            weights_[static_cast<std::size_t>(k)] * values[static_cast<std::size_t>(first + k)];
  }
  return out;
}

void Shift::apply(std::span<float> row, std::size_t stride) const {
  std::vector<float> column(row.size() / stride);
  for (std::size_t k = 0; k < stride; ++k) {
    for (std::size_t b = 0; b < column.size(); ++b) column[b] = row[b * stride + k];
    const std::vector<float> shifted = apply(column);
    for (std::size_t b = 0; b < column.size(); ++b) row[b * stride + k] = shifted[b];
  }
}

}  // namespace echofuse::recon
