// SPDX-License-Identifier: MIT
#include "drivers/tdc/histogram.hpp"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <utility>

#include "drivers/util/exit_code.hpp"

namespace echofuse::tdc {
namespace {

// Additional elements after those of the bins. `out_of_range` is the first, because
// ClickBins::bin() returns the number of bins for an out-of-range click.
enum ExtraCell : std::uint32_t { out_of_range, without_start, start, other, cells };

constexpr std::uint32_t max_bins = 1u << 24;

// Largest range for which (distance + 0.5) / width, computed in double, is never rounded into
// another bin.
constexpr std::uint64_t max_range_ps = 1ull << 50;

void check(const HistogramSettings& s) {
  const auto refuse = [](const std::string& text) { throw Error(ExitCode::config, text); };
  if (s.bins == 0 || s.bins > max_bins) refuse("histogram bins: expected 1 to 2^24");
  if (s.bin_width_ps < 1) refuse("bin width: expected at least 1 ps");
  if (s.start_channel == s.click_channel)
    refuse("start and click have the same channel " + std::to_string(s.start_channel));
  if (static_cast<std::uint64_t>(s.bin_width_ps) > max_range_ps / s.bins)
    refuse("histogram range: expected at most 2^50 ps");
  constexpr std::int64_t max_delay_ps = 1'000'000'000;
  if (std::abs(s.click_delay_ps) > max_delay_ps) refuse("delay: expected at most 1 ms");
  if (s.dead_time_ps < 0 || s.dead_time_ps > max_delay_ps) refuse("dead time: expected 0 to 1 ms");
}

}  // namespace

Histogram::Histogram(const HistogramSettings& settings)
    : settings_(settings),
      gaps_(settings.start_channel),
      filter_({settings.start_channel, settings.click_channel, settings.click_delay_ps,
               settings.dead_time_ps}) {
  check(settings);
  click_bins_ = {.start_channel = settings.start_channel,
                 .click_channel = settings.click_channel,
                 .first_bin_ps = static_cast<std::uint64_t>(settings.first_bin_ps),
                 .range_ps = static_cast<std::uint64_t>(settings.bin_width_ps) * settings.bins,
                 .bins_per_ps = 1.0 / static_cast<double>(settings.bin_width_ps)};
  bins_.resize(std::size_t{settings.bins} + cells);
}

void Histogram::add(std::span<const Tag> tags) {
  gaps_.add(tags);
  if (filter_.passes_all()) return count(tags);
  count(filter_.feed(tags));
  count_removed();
}

void Histogram::flush() { count(filter_.flush()); }

void Histogram::count_removed() {
  const std::uint64_t removed = filter_.take_removed();
  totals_.tags += removed;
  totals_.other += removed;
  totals_.removed += removed;
}

void Histogram::count(std::span<const Tag> tags) {
  if (fresh_) {
    const auto first = std::find_if(tags.begin(), tags.end(), std::mem_fn(&Tag::is_time_tag));
    fresh_ = first == tags.end();
    if (!fresh_) run_.last_time_ps = static_cast<std::uint64_t>(first->time_ps);
  }
  const std::size_t all = tags.size();
  std::size_t step = max_group;
  while (!tags.empty()) {
    const std::size_t taken =
        has_start_ ? count_groups(tags.data(), tags.size(), click_bins_, run_, bins_.data()) : 0;
    // The fast path cannot process a group that contains a marker. The doubled step avoids repeated
    // unsuccessful calls of count_groups().
    step = taken > 0 ? max_group : 2 * step;
    const auto few = tags.subspan(taken, std::min(step, tags.size() - taken));
    count_singly(few);
    tags = tags.subspan(taken + few.size());
  }
  commit(all);
}

// Every time tag increments exactly one element. It is selected without branches, because the
// processor cannot predict the sequence of starts and clicks.
void Histogram::count_singly(std::span<const Tag> tags) {
  const std::uint32_t bins = settings_.bins;
  const ClickBins click_bins = click_bins_;
  std::uint32_t* const cell = bins_.data();
  TagRun run = run_;
  bool has_start = has_start_, serves = !in_overflow_;
  for (const Tag& tag : tags) {
    // Tests type and reserved byte in one comparison, so that valid streams are not slowed down.
    std::uint16_t head;
    std::memcpy(&head, &tag, sizeof head);
    if (head != 0) [[unlikely]] {
      has_start_ = has_start;
      add_marker(tag);
      has_start = has_start_, serves = !in_overflow_;
      ++cell[bins + other];
      continue;
    }
    const auto time = static_cast<std::uint64_t>(tag.time_ps);
    run.backwards += (time - run.last_time_ps) >> 63;
    run.last_time_ps = time;
    const bool is_start = tag.channel == click_bins.start_channel;
    std::uint32_t index = click_bins.bin(time, run.last_start_ps);
    index = has_start ? index : bins + without_start;
    index = tag.channel == click_bins.click_channel ? index : bins + other;
    index = is_start ? bins + start : index;
    // Uses arithmetic instead of the operator ?:, which GCC 12 compiles to a branch.
    run.last_start_ps ^= (run.last_start_ps ^ time) & -std::uint64_t{is_start};
    has_start |= is_start & serves;
    ++cell[index];
  }
  run_ = run;
  has_start_ = has_start;
}

void Histogram::add_marker(const Tag& tag) {
  if (!tag.is_valid()) {
    ++totals_.bad_tags;
    return;
  }
  if (tag.type == TagType::missed_events) {
    if (tag.channel == settings_.start_channel || tag.channel == settings_.click_channel)
      totals_.missed += tag.missed_events;
    return;
  }
  totals_.overflows += tag.type == TagType::overflow_begin;
  totals_.errors += tag.type == TagType::error;
  if (tag.type != TagType::error) in_overflow_ = tag.type == TagType::overflow_begin;
  has_start_ = false;
}

// Adds the sums of one add() call and the additional 32-bit elements to the totals, and resets
// them.
void Histogram::commit(std::size_t tags) {
  const auto take_cell = [this](ExtraCell c) {
    return std::exchange(bins_[std::size_t{settings_.bins} + c], 0u);
  };
  const std::uint64_t off_axis = take_cell(out_of_range), lonely = take_cell(without_start);
  const std::uint64_t starts = take_cell(start) + std::exchange(run_.starts, 0);
  const std::uint64_t others = take_cell(other) + std::exchange(run_.others, 0);
  totals_.tags += tags;
  totals_.starts += starts;
  totals_.out_of_range += off_axis;
  totals_.without_start += lonely;
  totals_.other += others;
  totals_.in_range += tags - starts - off_axis - lonely - others;
  totals_.backwards += std::exchange(run_.backwards, 0);
}

void Histogram::forget_start() {
  flush();
  gaps_.forget_start();
  has_start_ = false;
  in_overflow_ = false;
  fresh_ = true;
}

void Histogram::follow(Histogram& before) {
  before.flush();
  std::swap(filter_, before.filter_);
  gaps_.forget_start();
  run_ = before.run_;
  fresh_ = before.fresh_, has_start_ = before.has_start_, in_overflow_ = before.in_overflow_;
}

std::vector<std::uint32_t> Histogram::counts() const {
  return {bins_.begin(), bins_.begin() + static_cast<std::ptrdiff_t>(settings_.bins)};
}

void Histogram::clear() {
  std::fill(bins_.begin(), bins_.end(), 0u);
  totals_ = {};
}

std::vector<std::uint32_t> Histogram::take() {
  auto taken = counts();
  clear();
  return taken;
}

Axis Histogram::axis() const {
  return spd_axis(settings_.bins, static_cast<double>(settings_.first_bin_ps),
                  static_cast<double>(settings_.bin_width_ps));
}

void StartGaps::add(std::span<const Tag> tags) {
  constexpr std::size_t enough = 100'000;
  for (const Tag& tag : tags) {
    if (gaps_ps_.size() == enough) return;
    if (!tag.is_time_tag()) has_last_ = false;
    if (!tag.is_time_tag() || tag.channel != channel_) continue;
    // Times are unsigned, because their differences may wrap.
    const auto time = static_cast<std::uint64_t>(tag.time_ps);
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
  // The laser period is estimated from a low percentile of the gaps, because a few gaps may be
  // wrong.
  const auto shortest = gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 200);
  std::nth_element(gaps.begin(), shortest, gaps.end());
  const std::int64_t period_ps = *shortest;
  const auto next = std::count_if(
      gaps.begin(), gaps.end(), [&](std::int64_t gap) { return gap - period_ps < period_ps / 2; });
  if (next < enough) return std::nullopt;
  return static_cast<double>(next) / static_cast<double>(gaps.size());
}

std::optional<double> StartGaps::clicks_per_pulse(std::uint64_t clicks,
                                                  std::uint64_t starts) const {
  const auto passed = share();
  if (!passed || starts == 0) return std::nullopt;
  return *passed * static_cast<double>(clicks) / static_cast<double>(starts);
}

}  // namespace echofuse::tdc
