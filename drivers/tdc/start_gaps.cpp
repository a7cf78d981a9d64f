// SPDX-License-Identifier: MIT
#include "drivers/tdc/start_gaps.hpp"

#include <algorithm>

namespace echofuse::tdc {

void StartGaps::add(std::span<const Tag> tags) {
  constexpr std::size_t enough = 100'000;
  for (const Tag& tag : tags) {
    if (gaps_ps_.size() == enough) return;
    if (!tag.is_time_tag()) has_last_ = false;
    if (!tag.is_time_tag() || tag.channel != channel_) continue;
    const auto time = static_cast<std::uint64_t>(tag.time_ps);  // its differences may wrap
    const auto gap = static_cast<std::int64_t>(time - last_ps_);
    if (has_last_ && gap > 0) gaps_ps_.push_back(gap);
    last_ps_ = time;
    has_last_ = true;
  }
}

std::optional<double> StartGaps::share() const {
  constexpr std::int64_t enough = 20;
  if (gaps_ps_.empty()) return std::nullopt;
  auto gaps = gaps_ps_;
  // The laser's period, whatever a few damaged times say.
  const auto shortest = gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 200);
  std::nth_element(gaps.begin(), shortest, gaps.end());
  const std::int64_t period_ps = *shortest;
  const auto next = std::count_if(
      gaps.begin(), gaps.end(), [&](std::int64_t gap) { return gap - period_ps < period_ps / 2; });
  if (next < enough) return std::nullopt;
  return static_cast<double>(next) / static_cast<double>(gaps.size());
}

std::optional<double> StartGaps::clicks_a_pulse(std::uint64_t clicks, std::uint64_t starts) const {
  const auto passed = share();
  if (!passed || starts == 0) return std::nullopt;
  return *passed * static_cast<double>(clicks) / static_cast<double>(starts);
}

}  // namespace echofuse::tdc
