// SPDX-License-Identifier: MIT
#include "acquire/intake/tag_check.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "drivers/core/median.hpp"
#include "drivers/tdc/tag_groups.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t sorted_within_ps = 1'000'000;
// Maximum number of positions by which sorting moves an event.
constexpr std::size_t max_moves = 1000;
constexpr std::size_t max_events = 20'000;
constexpr auto overflow_time = 3s;
constexpr std::uint64_t enough = 20;

std::string time_text(double ps) {
  if (ps >= 1e12) return format("%.4g s", ps / 1e12);
  if (ps >= 1e9) return format("%.4g ms", ps / 1e9);
  if (ps >= 1e6) return format("%.4g us", ps / 1e6);
  return format("%.4g ns", ps / 1e3);
}

// Returns the shortest gap between starts that occurs often. Rare gaps are ignored, because they
// may be due to corrupted times. The gaps must be sorted.
double shortest_often(const std::vector<std::uint64_t>& gaps_ps) {
  for (std::size_t i = 0; i + enough <= gaps_ps.size(); ++i) {
    const auto from = static_cast<double>(gaps_ps[i]);
    if (static_cast<double>(gaps_ps[i + enough - 1]) <= from * 1.05) return from;
  }
  return 0;
}

std::uint64_t count_near(const std::vector<std::uint64_t>& values, double expected, double share) {
  return static_cast<std::uint64_t>(std::ranges::count_if(
      values, [&](std::uint64_t v) { return near(static_cast<double>(v), expected, share); }));
}

}  // namespace

std::string rate_text(double hz) {
  if (hz >= 1e6) return format("%.4g MHz", hz / 1e6);
  return hz >= 1e3 ? format("%.4g kHz", hz / 1e3) : format("%.4g Hz", hz);
}

std::string comb_text(long double step_ps, std::int64_t bin_width_ps) {
  // If a bin contains fewer time steps than this, one additional step makes it noticeably wider
  // than its neighbours.
  constexpr long double few = 20;
  const long double steps = static_cast<long double>(bin_width_ps) / step_ps;
  if (steps >= few || std::abs(steps - std::round(steps)) <= 1e-6L * steps) return {};
  return format(
      "tag times are multiples of %.5Lg ps, so bins of %lld ps have uneven widths; use --set "
      "tdc.bin_width_ps=%.5Lg",
      step_ps, static_cast<long long>(bin_width_ps), std::max(1.0L, std::round(steps)) * step_ps);
}

TagCheck::TagCheck(const tdc::HistogramSettings& use, bool live, ReportFault report)
    : use_(use), live_(live), report_(std::move(report)) {}

void TagCheck::take(const TagBlock& block, const Output& out) {
  if (block.lost_blocks > 0) {  // the time tagger may have been reconnected
    last_ps_.reset(), clock_.restart(), overflow_from_.reset();
    highest_ps_ = offset_ps_ = 0;
  }
  if (block.lost_blocks > 0 || block.lost_items > 0) last_start_ps_.reset();
  const bool plain = is_plain(block), orderly = plain || in_order(block);
  hold_ = hold_ || !orderly;
  if (offset_ps_ > 0 || hold_ || !held_.empty()) {
    const std::size_t waited = held_.size();
    repaired_ = std::exchange(held_, {});
    repaired_.insert(repaired_.end(), block.tags.begin(), block.tags.end());
    for (Tag& tag : std::span(repaired_).subspan(waited))
      if (tag.is_time_tag()) repair(tag);
    sort();
    const auto all = std::span(repaired_).first(hold_ ? ready() : repaired_.size());
    const std::size_t first = std::min(waited, all.size());
    if (first > 0) pass({.received = held_received_, .tags = all.first(first)}, out);
    held_.assign(repaired_.begin() + std::ssize(all), repaired_.end());
    held_received_ = block.received;
    TagBlock rest = block;
    rest.tags = all.subspan(first);
    pass(rest, out);
  } else {
    for (auto tag = block.tags.rbegin(); tag != block.tags.rend(); ++tag)
      if (tag->is_time_tag()) {
        last_ps_ = static_cast<std::uint64_t>(tag->time_ps);
        highest_ps_ = std::max(highest_ps_, *last_ps_);
        break;
      }
    pass(block, out, plain);
  }
  if (!second_from_) second_from_ = block.received;
  if (block.received - *second_from_ >= 1s) check_second(block.received);
}

void TagCheck::pass(const TagBlock& block, const Output& out, bool plain) {
  auto rest = block.tags;
  for (; !rest.empty() && sample_.events < max_events; rest = rest.subspan(1))
    check_tag(rest.front(), block.received);
  if (!rest.empty()) last_start_ps_.reset();
  if (!plain)
    for (const Tag& tag : rest)
      if (!tag.is_time_tag()) take_marker(tag, block.received);
  out(block);
}

// Returns true if the block contains only time tags and the tags are in order. This test is fast
// enough to be made on every tag of a run.
bool TagCheck::is_plain(const TagBlock& block) const {
  if (block.tags.empty()) return true;
  const auto first_ps = static_cast<std::uint64_t>(block.tags.front().time_ps);
  return tdc::only_ordered_times(block.tags, last_ps_.value_or(first_ps));
}

// Returns the number of events that need not wait, because later blocks cannot contain earlier
// events.
std::size_t TagCheck::ready() const {
  std::size_t count = repaired_.size();
  const auto may_be_preceded = [&](const Tag& tag) {
    return tag.is_time_tag() && static_cast<std::uint64_t>(repaired_.back().time_ps) -
                                        static_cast<std::uint64_t>(tag.time_ps) <=
                                    sorted_within_ps;
  };
  while (count > 0 && repaired_.size() - count < max_moves && may_be_preceded(repaired_[count - 1]))
    --count;
  return count;
}

void TagCheck::flush(const Output& out) {
  repaired_ = std::exchange(held_, {});
  if (!repaired_.empty()) pass({.received = held_received_, .tags = repaired_}, out);
}

bool TagCheck::in_order(const TagBlock& block) const {
  auto last = last_ps_;
  for (const Tag& tag : block.tags) {
    if (!tag.is_time_tag()) continue;
    const auto time = static_cast<std::uint64_t>(tag.time_ps);
    if (last && static_cast<std::int64_t>(time - *last) < 0) return false;
    last = time;
  }
  return true;
}

// Detects wraps and backward steps. Adds the offset of all previous wraps to the time of the event.
void TagCheck::repair(Tag& tag) {
  const auto time = static_cast<std::uint64_t>(tag.time_ps);
  // An event that is out of order may have a time from before the last wrap.
  const std::uint64_t wrap_ps = std::uint64_t{1} << wrap_bits_;
  if (offset_ps_ > 0 && last_ps_ && time < wrap_ps &&
      *last_ps_ + wrap_ps - time <= sorted_within_ps) {
    tag.time_ps = static_cast<std::int64_t>(time + offset_ps_ - wrap_ps);
    return;
  }
  const auto step = static_cast<std::int64_t>(time - last_ps_.value_or(time));
  highest_ps_ = std::max(highest_ps_, time);
  if (step < 0) {
    const auto down = static_cast<std::uint64_t>(-step);
    const auto wraps_at = [&](unsigned bits) {
      const std::uint64_t end = std::uint64_t{1} << bits;
      return highest_ps_ < end && highest_ps_ >= end - end / 4 && down >= end / 2;
    };
    if (const unsigned bits = wraps_at(32) ? 32 : wraps_at(40) ? 40 : 0; bits > 0) {
      offset_ps_ += std::uint64_t{1} << bits;
      wrap_bits_ = bits, ++wrapped_;
    } else if (down > sorted_within_ps) {
      ++stepped_back_;
      farthest_back_ps_ = std::max(farthest_back_ps_, down);
    }
  }
  last_ps_ = time;
  tag.time_ps = static_cast<std::int64_t>(time + offset_ps_);
}

void TagCheck::sort() {
  for (std::size_t i = 1; i < repaired_.size(); ++i) {
    const Tag tag = repaired_[i];
    std::size_t to = i;
    const auto before = [&](const Tag& other) {
      const std::uint64_t by =
          static_cast<std::uint64_t>(other.time_ps) - static_cast<std::uint64_t>(tag.time_ps);
      return tag.is_time_tag() && other.is_time_tag() && by > 0 && by <= sorted_within_ps;
    };
    while (to > 0 && i - to < max_moves && before(repaired_[to - 1])) {
      repaired_[to] = repaired_[to - 1];
      --to;
    }
    if (to == i) continue;
    repaired_[to] = tag;
    ++sorted_;
  }
}

void TagCheck::take_marker(const Tag& tag, HostTime received) {
  last_start_ps_.reset();
  if (!tag.is_valid()) {
    ++invalid_;
    return;
  }
  if (tag.type == TagType::overflow_end || tag.type == TagType::error) overflow_from_.reset();
  if (tag.type == TagType::overflow_begin || (overflow_from_ && tag.type == TagType::missed_events))
    overflow_from_ = received, overflow_reported_ = false;
}

void TagCheck::check_tag(const Tag& tag, HostTime received) {
  if (!tag.is_time_tag()) return take_marker(tag, received);
  const auto time = static_cast<std::uint64_t>(tag.time_ps);
  ++sample_.events;
  if (tag.channel == use_.start_channel) {
    ++sample_.starts;
    if (last_start_ps_ && static_cast<std::int64_t>(time - *last_start_ps_) > 0)
      sample_.gaps_ps.push_back(time - *last_start_ps_);
    last_start_ps_ = time, clicks_ = 0;
  } else if (tag.channel == use_.click_channel && last_start_ps_) {
    const auto after = static_cast<std::int64_t>(time - *last_start_ps_);
    sample_.step_ps = std::gcd(sample_.step_ps, static_cast<std::uint64_t>(std::abs(after)));
    sample_.firsts += clicks_ == 0;
    if (clicks_ == 1) {
      ++sample_.seconds;
      sample_.delays_ps.push_back(time - *last_click_ps_);
    }
    last_click_ps_ = time, ++clicks_;
  }
}

void TagCheck::check_second(HostTime received) {
  if (live_) check_clock(received);
  check_overflow(received);
  if (invalid_ > 0)
    found(invalid, std::exchange(invalid_, 0),
          "tags with an unknown type or a nonzero reserved byte, which are ignored; check the "
          "program that sends them");
  if (wrapped_ > 0)
    found(wrap, std::exchange(wrapped_, 0),
          format("wrap-arounds of the tagger's time at 2^%u ps; times in the run continue without "
                 "a jump",
                 wrap_bits_));
  if (sorted_ > 0)
    found(order, std::exchange(sorted_, 0),
          "events out of order by up to 1 us; the events were sorted");
  check_starts();
  check_clicks();
  if (stepped_back_ > 0)
    found(back, std::exchange(stepped_back_, 0),
          "backward steps of the tagger's time by up to " +
              time_text(static_cast<double>(farthest_back_ps_)) +
              "; check whether its counter wraps or restarts");
  sample_ = {};
  last_start_ps_.reset();
  second_from_ = received;
  hold_ = faults_[order].count > 0;
}

void TagCheck::check_clock(HostTime received) {
  if (!last_ps_ || sample_.events == 0) return;
  if (stepped_back_ > 0) clock_.restart();
  if (const std::string rate = clock_.add(*last_ps_ + offset_ps_, received); !rate.empty())
    found(clock, 1,
          "intervals of 2 s in which the tagger's clock " + rate +
              "; check that its times are in ps. Receipt times are used instead");
}

void TagCheck::check_overflow(HostTime received) {
  if (!overflow_from_ || overflow_reported_ || received - *overflow_from_ < overflow_time) return;
  overflow_reported_ = true;
  found(overflow, 1,
        "overflows that did not end within 3 s; clicks are not counted during an overflow");
}

void TagCheck::check_starts() {
  auto& gaps = sample_.gaps_ps;
  if (gaps.size() < 5 * enough) return;
  const std::vector<std::uint64_t> in_time = gaps;
  std::ranges::sort(gaps);
  const auto count = static_cast<double>(gaps.size());
  const bool filtered = sample_.starts < 2 * sample_.firsts;
  double period_ps = shortest_often(gaps);
  // A doubled start splits the period into a short gap and a long gap.
  const double long_ps = static_cast<double>(gaps[gaps.size() * 9 / 10]) / 4;
  const auto border = std::ranges::lower_bound(gaps, static_cast<std::uint64_t>(long_ps));
  std::vector<std::uint64_t> shorts(gaps.begin(), border), longs(border, gaps.end());
  if (static_cast<double>(shorts.size()) > 0.02 * count && shorts.size() >= enough) {
    const auto usual_ps = static_cast<double>(median(shorts)),
               rest_ps = static_cast<double>(median(longs));
    if (static_cast<double>(count_near(longs, rest_ps, 0.05)) >
            0.8 * static_cast<double>(longs.size()) &&
        static_cast<double>(count_near(shorts, usual_ps, 0.2)) >
            0.8 * static_cast<double>(shorts.size())) {
      found(doubled, shorts.size(),
            "starts followed by a second start after " + time_text(usual_ps) +
                "; check the trigger level, and the start line for a reflection");
      period_ps = static_cast<double>(gaps.back());
    }
  }
  // Nearly all gaps between starts must be whole multiples of the period. Otherwise the starts are
  // not periodic, or there are too few of them.
  std::uint64_t lost = 0;
  double whole = 0, next = 0;
  for (const std::uint64_t gap : gaps) {
    const double periods = static_cast<double>(gap) / std::max(1.0, period_ps);
    if (std::abs(periods - std::round(periods)) > 0.1 || periods < 0.5 || periods > 20) continue;
    ++whole;
    next += std::round(periods) == 1;
    lost += static_cast<std::uint64_t>(std::round(periods)) - 1;
  }
  next_share_ = next / count;
  const bool split = period_ps == static_cast<double>(gaps.back());
  if (period_ps <= 0 || next_share_ < 0.02 || whole < (split ? 0.4 : 0.9) * count) return;
  if (period_ps_ > 0 && !near(period_ps, period_ps_, 0.05))
    found(period, 1,
          "changes of the start rate, from " + rate_text(1e12 / period_ps_) + " to " +
              rate_text(1e12 / period_ps));
  period_ps_ = period_ps;
  const double share = static_cast<double>(lost) / (static_cast<double>(lost) + count);
  // A lost start lengthens a single gap, whereas a change of the rate changes all gaps. A backward
  // step of the clock also displaces starts.
  std::uint64_t changes = 0;
  for (std::size_t i = 1; i < in_time.size(); ++i)
    changes += near(static_cast<double>(in_time[i - 1]), period_ps, 0.1) !=
               near(static_cast<double>(in_time[i]), period_ps, 0.1);
  if (!filtered && share > 0.02 && whole > 0.9 * count && changes >= enough &&
      2 * stepped_back_ < lost)
    found(
        missing, lost,
        format("start pulses are missing, %.0f %% (intervals of several periods of ", 100 * share) +
            time_text(period_ps) + "); check the trigger level");
}

void TagCheck::check_clicks() {
  if (sample_.firsts < 5 * enough) return;
  if (const auto step = static_cast<long double>(sample_.step_ps); step > 1)
    if (const std::string text = comb_text(step, use_.bin_width_ps); !text.empty())
      found(steps, 1, text);
  const auto firsts = static_cast<double>(sample_.firsts);
  const double share = static_cast<double>(sample_.seconds) / firsts;
  const bool filtered = sample_.starts < 2 * sample_.firsts;
  const double chance = filtered ? next_share_ : firsts / static_cast<double>(sample_.starts);
  if (sample_.seconds < enough || share < 0.1 || share < 2 * chance) return;
  const auto delay_ps = static_cast<double>(median(sample_.delays_ps));
  const auto around = std::ranges::count_if(sample_.delays_ps, [&](std::uint64_t d) {
    return std::abs(static_cast<double>(d) - delay_ps) < 1000;
  });
  if (static_cast<double>(around) < 0.5 * static_cast<double>(sample_.seconds)) return;
  if (delay_ps < static_cast<double>(use_.dead_time_ps)) return;
  if (delay_ps < 1)
    return found(second, sample_.seconds,
                 "clicks arrive twice with the same time; does the device send its tags twice? Set "
                 "tdc.dead_time_ps to remove the copies");
  found(second, sample_.seconds,
        "clicks are followed by a second click after " + time_text(delay_ps) +
            format(", which causes a second peak %.2f m behind the first: afterpulses or a "
                   "reflection; set tdc.dead_time_ps to remove these clicks",
                   delay_ps / ps_per_m));
}

void TagCheck::found(FaultType kind, std::uint64_t count, const std::string& cause) {
  TagFault& fault = faults_[kind];
  fault.count += count;
  fault.cause = cause;
  if (live_ && fault.reported == 0) report(kind);
}

void TagCheck::report(FaultType kind) {
  TagFault& fault = faults_[kind];
  report_(kind == steps ? fault.cause : std::to_string(fault.count) + " " + fault.cause);
  fault.reported = fault.count;
}

void TagCheck::finish() {
  if (second_from_) check_second(*second_from_);
  for (std::size_t kind = 0; kind < faults_.size(); ++kind)
    if (kind != steps || faults_[kind].reported == 0)
      if (faults_[kind].count > faults_[kind].reported) report(static_cast<FaultType>(kind));
}

}  // namespace echofuse::acquire
