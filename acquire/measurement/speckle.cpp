// SPDX-License-Identifier: MIT
#include "acquire/measurement/speckle.hpp"

#include <algorithm>
#include <bit>

namespace echofuse::record {
namespace {

// 150 ms, but for what times are off; of a slow radar its next frame.
constexpr double least_lag_s = 0.14, most_lag_s = 0.25;

}  // namespace

void SpeckleStatistics::add(std::uint64_t frame, std::size_t carrier, double time_s,
                            std::span<const float> power) {
  if (frame_ != frame) {
    frame_ = frame, seen_ = 0;
    now_.assign(power.size(), 0), squares_now_.assign(power.size(), 0);
    for (auto* sums : {&sum_, &squares_, &within_, &apart_}) sums->resize(power.size());
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
    now_[i] /= n;
    sum_[i] += now_[i], squares_[i] += now_[i] * now_[i];
    if (carriers_ > 1) within_[i] += (squares_now_[i] - n * now_[i] * now_[i]) / (n - 1);
  }
  compare(time_s);
}

// With the last frame that was long enough before.
void SpeckleStatistics::compare(double time_s) {
  if (!recent_.empty() && time_s <= recent_.back().time_s) recent_.clear();  // another clock
  while (!recent_.empty() && time_s - recent_.front().time_s > most_lag_s) recent_.pop_front();
  const auto before = std::find_if(recent_.rbegin(), recent_.rend(), [&](const Frame& f) {
    return time_s - f.time_s >= least_lag_s;
  });
  if (before != recent_.rend()) {
    for (std::size_t i = 0; i < now_.size(); ++i) {
      const double difference = now_[i] - before->power[i];
      apart_[i] += difference * difference / 2;
    }
    ++pairs_;
  }
  recent_.push_back({time_s, now_});
}

std::optional<Speckle> SpeckleStatistics::take() const {
  if (frames_ < 2) return {};
  const auto n = static_cast<double>(frames_);
  double frames = 0, carriers = 0, apart = 0, power = 0;
  for (std::size_t i = 0; i < sum_.size(); ++i) {
    const double mean = sum_[i] / n, weight = mean * mean;
    frames += weight * std::max((squares_[i] - n * weight) / (n - 1), 0.0);
    carriers += weight * std::max(within_[i] / n, 0.0);
    apart += weight * apart_[i] / std::max(pairs_, 1.0);
    power += weight * weight;
  }
  if (!(power > 0)) return {};
  Speckle out{frames / power, {}, {}};
  if (carriers_ > 1) out.over_carriers = carriers / power;
  if (pairs_ > 0) out.over_150_ms = apart / power;
  return out;
}

}  // namespace echofuse::record
