// SPDX-License-Identifier: MIT
#include "acquire/intake/clock_fit.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

namespace echofuse::acquire {
namespace {

using namespace std::chrono_literals;

constexpr double history_s = 128, stretch_s = 0.5;
constexpr double steepest = 500e-6, steepest_after_s = 32;
constexpr std::uint64_t enough_samples = 32;
constexpr double enough_s = 0.5;
constexpr auto longest_gap = 10s;
constexpr double early_limit_s = 0.25, back_limit_s = 1, agreement_s = 1;
constexpr double late_limit_s = 0.1;
constexpr double other_rate = 0.05;
constexpr auto late_long = 3s;
constexpr unsigned late_samples = 10;
// Limit for host times in s. A corrupted device time may have any value, but its host time in
// nanoseconds must fit in 64 bits.
constexpr double farthest_s = 1e9;

}  // namespace

std::int64_t ticks_passed(std::uint64_t from, std::uint64_t to, double expected,
                          unsigned spare_bits) {
  const auto near = static_cast<std::uint64_t>(std::llround(expected));
  const auto off = static_cast<std::int64_t>((to - from - near) << spare_bits) >> spare_bits;
  return static_cast<std::int64_t>(near + static_cast<std::uint64_t>(off));
}

void ClockFit::begin(const Receipt& receipt) {
  history_.clear();
  samples_ = 0;
  suspect_.reset();
  late_.reset();
  last_ = receipt;
  last_ticks_ = 0;
  first_s_ = static_cast<double>(static_cast<std::int64_t>(receipt.ticks)) * tick_s_;
  began_ = receipt.received;
  newest_s_ = intercept_s_ = slope_ = edge_slope_ = residual_s_ = 0;
  take({0, 0});
}

std::int64_t ClockFit::advance(const Receipt& from, const Receipt& to) const {
  return ticks_passed(from.ticks, to.ticks, seconds(to.received - from.received) / tick_s_,
                      spare_bits_);
}

ClockFit::ClockSample ClockFit::sample_of(const Receipt& receipt) const {
  const auto ticks =
      static_cast<std::uint64_t>(last_ticks_) + static_cast<std::uint64_t>(advance(last_, receipt));
  const double device_s = static_cast<double>(static_cast<std::int64_t>(ticks)) * tick_s_;
  return {device_s, seconds(receipt.received - began_) - device_s};
}

bool ClockFit::agree(const Receipt& first, const Receipt& second) const {
  const double device_s = static_cast<double>(advance(first, second)) * tick_s_;
  return device_s > 0 &&
         std::abs(seconds(second.received - first.received) - device_s) < agreement_s;
}

bool ClockFit::jumps(const ClockSample& sample) const {
  return sample.excess_s - line(sample.device_s) < -early_limit_s ||
         sample.device_s < newest_s_ - back_limit_s;
}

bool ClockFit::steps(const ClockSample& sample, HostTime received) {
  if (sample.excess_s - line(sample.device_s) < late_limit_s) {
    late_.reset();
    return false;
  }
  if (!late_) late_ = {received, 0};
  return ++late_->samples >= late_samples && received - late_->since > late_long;
}

void ClockFit::add(std::uint64_t ticks, HostTime received) {
  const Receipt receipt{ticks, received};
  if (history_.empty() || received - last_.received > longest_gap) return begin(receipt);
  ClockSample sample = sample_of(receipt);
  if (jumps(sample)) {
    const auto before = std::exchange(suspect_, receipt);
    if (!before || !agree(*before, receipt)) return;
    begin(*before);
    sample = sample_of(receipt);
  }
  suspect_.reset();
  if (steps(sample, received)) return begin(receipt);
  last_ticks_ += advance(last_, receipt);
  last_ = receipt;
  take(sample);
}

void ClockFit::take(const ClockSample& sample) {
  newest_s_ = std::max(newest_s_, sample.device_s);
  const auto stretch = static_cast<std::int64_t>(std::floor(sample.device_s / stretch_s));
  ++samples_;
  if (history_.empty() || stretch > history_.back().stretch) {
    history_.push_back({sample, stretch, 1});
    while (history_.front().sample.device_s < newest_s_ - history_s) {
      samples_ -= history_.front().samples;
      history_.pop_front();
    }
    return fit();
  }
  IntervalMinimum& interval = history_.back();
  ++interval.samples;
  const auto delay = [this](const ClockSample& s) { return s.excess_s - line(s.device_s); };
  if (stretch < interval.stretch || delay(sample) >= delay(interval.sample)) return;
  interval.sample = sample;
  fit();
}

void ClockFit::fit() {
  std::vector<ClockSample> hull;  // lower convex hull, by Andrew's monotone chain
  double middle_s = 0;
  for (const IntervalMinimum& interval : history_) {
    const ClockSample& p = interval.sample;
    const auto needless = [&] {
      const ClockSample &a = hull[hull.size() - 2], &b = hull.back();
      return (b.excess_s - a.excess_s) * (p.device_s - a.device_s) >=
             (p.excess_s - a.excess_s) * (b.device_s - a.device_s);
    };
    while (hull.size() >= 2 && needless()) hull.pop_back();
    hull.push_back(p);
    middle_s += p.device_s / static_cast<double>(history_.size());
  }
  slope_ = edge_slope_ = 0;
  if (hull.size() >= 2) {
    const auto right = std::find_if(hull.begin() + 1, hull.end() - 1,
                                    [&](const ClockSample& p) { return p.device_s >= middle_s; });
    const auto left = right - 1;
    const double limit =
        steepest * std::min(1.0, (newest_s_ - hull.front().device_s) / steepest_after_s);
    edge_slope_ = (right->excess_s - left->excess_s) / (right->device_s - left->device_s);
    slope_ = std::clamp(edge_slope_, -limit, limit);
  }
  intercept_s_ = std::numeric_limits<double>::max();
  for (const ClockSample& p : hull)
    intercept_s_ = std::min(intercept_s_, p.excess_s - slope_ * p.device_s);
  residual_s_ = 0;
  for (const IntervalMinimum& interval : history_)
    residual_s_ += (interval.sample.excess_s - line(interval.sample.device_s)) /
                   static_cast<double>(history_.size());
}

bool ClockFit::sound() const {
  return samples_ >= enough_samples && !suspect_ && std::abs(edge_slope_) < other_rate &&
         newest_s_ - history_.front().sample.device_s >= enough_s;
}

HostTime ClockFit::taken(std::uint64_t ticks, HostTime received) const {
  if (!sound()) return received;
  const double device_s = sample_of({ticks, received}).device_s;
  const double host_s = std::clamp(device_s + line(device_s), -farthest_s, farthest_s);
  return std::min(began_ + HostTime(std::llround(1e9 * host_s)), received);
}

std::optional<record::ClockState> ClockFit::state(HostTime at) const {
  if (!sound()) return std::nullopt;
  // Solves device_s + line(device_s) = host_s for the device time.
  const double host_s = seconds(at - began_);
  const double device_s = (host_s - intercept_s_) / (1 + slope_);
  return record::ClockState{.offset_s = seconds(at) - (first_s_ + device_s),
                            .drift_ppm = 1e6 * (1 / (1 + slope_) - 1),
                            .residual_s = residual_s_,
                            .samples = samples_};
}

// Uses only the last event of a block, because it spent the least time waiting for the block to be
// sent.
void SensorClocks::observe(const TagBlock& block) {
  const auto last =
      std::find_if(block.tags.rbegin(), block.tags.rend(), std::mem_fn(&Tag::is_time_tag));
  if (last != block.tags.rend())
    of(Sensor::spd).add(static_cast<std::uint64_t>(last->time_ps), block.received);
}

void SensorClocks::observe(const HistogramFrame& frame) {
  of(Sensor::spd).add(device_clock_of(frame), frame.received);
}

void SensorClocks::observe(const RadarFrame& frame) {
  of(Sensor::radar).add(frame.time_cpu_cycles, frame.received);
}

void SensorClocks::observe(const DepthFrame& frame) {
  of(Sensor::depth).add(frame.device_time_us, frame.received);
}

}  // namespace echofuse::acquire
