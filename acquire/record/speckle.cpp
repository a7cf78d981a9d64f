// SPDX-License-Identifier: MIT
#include "acquire/record/speckle.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace echofuse::record {
namespace {

// Who stands sways; within this time little of it, and more than noise at 20 dB.
constexpr double lag_s = 0.15;

}  // namespace

void SpeckleStatistics::add(std::uint64_t frame, std::size_t carrier, double time_s,
                            std::span<const float> power) {
  if (frame_ != frame) {
    frame_ = frame, seen_ = 0;
    now_.assign(power.size(), 0), squares_now_.assign(power.size(), 0);
  }
  seen_ |= std::uint64_t{1} << carrier;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const auto p = double{power[i]};
    now_[i] += p, squares_now_[i] += p * p;
  }
  if (static_cast<std::size_t>(std::popcount(seen_)) < carriers_) return;
  seen_ = 0;
  const auto n = static_cast<double>(carriers_);
  for (std::size_t i = 0; i < power.size(); ++i) {
    now_[i] /= n;
    if (carriers_ > 1) within_ += (squares_now_[i] - n * now_[i] * now_[i]) / (n - 1);
  }
  frames_.push_back({frame, time_s, now_});
}

std::optional<Speckle> SpeckleStatistics::take() const {
  if (frames_.size() < 2) return {};
  const auto n = static_cast<double>(frames_.size());
  double variance = 0, power = 0;
  for (std::size_t i = 0; i < frames_.front().power.size(); ++i) {
    double sum = 0, squares = 0;
    for (const Frame& f : frames_) sum += f.power[i], squares += f.power[i] * f.power[i];
    const double mean = sum / n;
    variance += (squares - n * mean * mean) / (n - 1);
    power += mean * mean;
  }
  if (!(power > 0)) return {};
  Speckle out{std::max(variance, 0.0) / power, {}, over_150_ms(power)};
  if (carriers_ > 1) out.over_carriers = std::max(within_ / n, 0.0) / power;
  return out;
}

std::optional<double> SpeckleStatistics::over_150_ms(double power) const {
  const Frame &first = frames_.front(), &last = frames_.back();
  const double period_s = (last.time_s - first.time_s) /
                          (static_cast<double>(last.number) - static_cast<double>(first.number));
  if (!(period_s > 0)) return {};
  const auto farther =
                 apart(static_cast<std::uint64_t>(std::max(2.0, std::round(lag_s / period_s)))),
             next = apart(1);
  if (!farther || !next) return {};
  return std::max(*farther - *next, 0.0) / power;
}

// Half the mean squared difference of frames so far from each other, summed over the range.
std::optional<double> SpeckleStatistics::apart(std::uint64_t frames) const {
  double sum = 0, pairs = 0;
  for (auto a = frames_.begin(); a != frames_.end(); ++a) {
    const auto b = std::find_if(a, frames_.end(),
                                [&](const Frame& f) { return f.number >= a->number + frames; });
    if (b == frames_.end() || b->number != a->number + frames) continue;
    for (std::size_t i = 0; i < a->power.size(); ++i) {
      const double difference = b->power[i] - a->power[i];
      sum += difference * difference / 2;
    }
    ++pairs;
  }
  return pairs > 0 ? std::optional(sum / pairs) : std::nullopt;
}

}  // namespace echofuse::record
