// SPDX-License-Identifier: MIT
#include "drivers/tdc/tag_filter.hpp"

#include <algorithm>

namespace echofuse::tdc {
namespace {

// Limit of the reorder buffer (1 ms at 1 Gtag/s). It is reached only if time stamps stop or run
// backwards.
constexpr std::size_t max_waiting = 1u << 20;

std::uint64_t time_of(const Tag& tag) { return static_cast<std::uint64_t>(tag.time_ps); }

}  // namespace

TagFilter::TagFilter(const FilterSettings& s)
    : start_{.number = s.start_channel},
      click_{.number = s.click_channel},
      click_delay_ps_(s.click_delay_ps),
      dead_time_ps_(static_cast<std::uint64_t>(s.dead_time_ps)),
      pass_through_(s.click_delay_ps == 0 && s.dead_time_ps == 0) {}

std::span<const Tag> TagFilter::feed(std::span<const Tag> tags) {
  if (pass_through_) return tags;
  ready_.clear();
  for (const Tag& tag : tags) take(tag);
  sort_waiting();
  if (waiting_.size() > max_waiting) {
    release(waiting_.size());
    return ready_;
  }
  // Earliest delayed time that later tags can have. Signed differences handle wrapped times.
  const std::uint64_t settled =
      newest_ + static_cast<std::uint64_t>(std::min(click_delay_ps_, std::int64_t{0}));
  const auto end = std::find_if(waiting_.begin(), waiting_.end(), [&](const Tag& tag) {
    return static_cast<std::int64_t>(time_of(tag) - settled) > 0;
  });
  release(static_cast<std::size_t>(end - waiting_.begin()));
  return ready_;
}

std::span<const Tag> TagFilter::flush() {
  ready_.clear();
  sort_waiting();
  release(waiting_.size());
  return ready_;
}

bool TagFilter::keep(Channel& channel, std::uint64_t time) {
  if (channel.any_kept && time - channel.last_kept < dead_time_ps_) {
    ++removed_;
    return false;
  }
  channel.last_kept = time;
  channel.any_kept = true;
  return true;
}

void TagFilter::take(Tag tag) {
  if (!tag.is_time_tag()) {
    sort_waiting();
    release(waiting_.size());
    ready_.push_back(tag);
    return;
  }
  newest_ = time_of(tag);
  Channel* channel = tag.channel == start_.number   ? &start_
                     : tag.channel == click_.number ? &click_
                                                    : nullptr;
  if (channel) {
    if (!keep(*channel, newest_)) return;
    if (channel == &click_)
      tag.time_ps =
          static_cast<std::int64_t>(newest_ + static_cast<std::uint64_t>(click_delay_ps_));
  }
  waiting_.push_back(tag);
}

// Sorts by the time difference from one of the tags, which is correct even if the times wrap.
void TagFilter::sort_waiting() {
  if (waiting_.empty()) return;
  const std::uint64_t base = time_of(waiting_.front());
  std::stable_sort(waiting_.begin(), waiting_.end(), [base](const Tag& a, const Tag& b) {
    return static_cast<std::int64_t>(time_of(a) - base) <
           static_cast<std::int64_t>(time_of(b) - base);
  });
}

void TagFilter::release(std::size_t count) {
  const auto end = waiting_.begin() + static_cast<std::ptrdiff_t>(count);
  ready_.insert(ready_.end(), waiting_.begin(), end);
  waiting_.erase(waiting_.begin(), end);
}

}  // namespace echofuse::tdc
