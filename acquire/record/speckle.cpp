// SPDX-License-Identifier: MIT
#include "acquire/record/speckle.hpp"

#include <algorithm>
#include <bit>

namespace echofuse::record {

void SpeckleStatistics::add(std::uint64_t frame, std::size_t carrier,
                            std::span<const float> power) {
  if (frame_ != frame) {
    frame_ = frame, seen_ = 0;
    now_.assign(power.size(), 0), squares_now_.assign(power.size(), 0);
    sum_.resize(power.size()), squares_.resize(power.size());
  }
  seen_ |= std::uint64_t{1} << carrier;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const auto p = double{power[i]};
    now_[i] += p, squares_now_[i] += p * p;
  }
  if (static_cast<std::size_t>(std::popcount(seen_)) < carriers_) return;
  seen_ = 0;
  ++frames_;
  const auto n = static_cast<double>(carriers_);
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double mean = now_[i] / n;
    sum_[i] += mean, squares_[i] += mean * mean;
    if (carriers_ > 1) within_ += (squares_now_[i] - n * mean * mean) / (n - 1);
  }
}

std::optional<Speckle> SpeckleStatistics::take() const {
  if (frames_ < 2) return {};
  const auto n = static_cast<double>(frames_);
  double variance = 0, power = 0;
  for (std::size_t i = 0; i < sum_.size(); ++i) {
    const double mean = sum_[i] / n;
    variance += (squares_[i] - n * mean * mean) / (n - 1);
    power += mean * mean;
  }
  if (!(power > 0)) return {};
  Speckle out{std::max(variance, 0.0) / power, {}};
  if (carriers_ > 1) out.over_carriers = std::max(within_ / n, 0.0) / power;
  return out;
}

}  // namespace echofuse::record
