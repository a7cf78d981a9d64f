// SPDX-License-Identifier: MIT
// Time tags -> histogram of the time from the last start to each click.
//
// Semantics: every click counts once, against the LAST start before it (as in the FPGA of Swabian's
// Time Tagger X link reference). The vendor's software Histogram is multiple-start, multiple-stop:
// a click is differenced with EVERY earlier start that is still in range, so it may count several
// times. With at most one start per range (laser period > first_bin + bins * bin_width) both agree.
//
// Error and overflow markers forget the last start: time information is missing on their other
// side, so clicks that follow have no start until the next one arrives. Between overflow_begin and
// overflow_end starts are counted but do not serve: the vendor says that tags are missing there.
//
// Tags with an unknown type or a reserved byte that is not 0 are counted and otherwise ignored. A
// time before that of the previous tag is counted, and the tag used as it is: a click before its
// start is out of range. Differences of times are taken modulo 2^64.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/core/sample.hpp"
#include "drivers/core/tag_counts.hpp"
#include "drivers/tdc/tag_filter.hpp"
#include "drivers/tdc/tag_groups.hpp"

namespace echofuse::tdc {

// Estimates the share of laser pulses that a time tagger transfers. A conditional filter drops
// starts without a click in the device. Clicks per start then do not indicate the light level, but
// the gaps between starts do. Pure.
class StartGaps {
 public:
  explicit StartGaps(std::int32_t start_channel) : channel_(start_channel) {}

  // Uses the first 100,000 gaps.
  void add(std::span<const Tag> tags);
  // Call when tags are missing.
  void forget_start() { has_last_ = false; }
  // Returns the share of pulses with a transferred start: of all starts, those followed by the
  // start of the next pulse. Without a filter it is 1. With a filter it is the probability of a
  // click, because pulses are independent. Below 0.5 % the estimate is too high, near 1 %. Returns
  // nothing if fewer than 20 starts are followed in this way.
  std::optional<double> share() const;
  // Returns clicks per laser pulse from the counts of clicks and transferred starts; nothing if the
  // share is unknown.
  std::optional<double> clicks_a_pulse(std::uint64_t clicks, std::uint64_t starts) const;

 private:
  std::int32_t channel_;
  bool has_last_ = false;
  std::uint64_t last_ps_ = 0;
  std::vector<std::int64_t> gaps_ps_;
};

// The defaults are two-way times of 2.0 to 7.04 m.
struct HistogramSettings {
  std::int32_t start_channel = 1;  // laser
  std::int32_t click_channel = 2;  // detector
  std::int64_t bin_width_ps = 100;
  std::int64_t first_bin_ps = 13343;  // start of bin 0; may be negative (cable delays)
  std::uint32_t bins = 336;
  // for taggers without these functions (tag_filter.hpp)
  std::int64_t click_delay_ps = 0, dead_time_ps = 0;
};

class Histogram {
 public:
  // Throws Error(config): no bins or more than 2^24, a bin width below 1 ps, equal start and click
  // channels, an axis longer than 2^50 ps, a dead time outside 0 to 1 ms, or a delay of more than 1
  // ms.
  explicit Histogram(const HistogramSettings& settings);

  void add(std::span<const Tag> tags);
  // Counts delayed tags that wait for their order.
  void flush();
  // Call when tags were lost (transport gap, new connection). The overflow state is then unknown
  // until the next marker.
  void forget_start();
  // Both since the last clear(). counts() has `bins` entries.
  std::vector<std::uint32_t> counts() const;
  TagCounts tag_counts() const { return totals_; }
  // Keeps the last start.
  void clear();
  // Returns counts() and clears.
  std::vector<std::uint32_t> take();
  // Continues after the tags of `before`, which is flushed: the last start stays valid across the
  // border of slots.
  void follow(Histogram& before);
  // Gaps between starts since the beginning.
  const StartGaps& gaps() const { return gaps_; }

  bool in_overflow() const { return in_overflow_; }  // clicks are not counted

  const HistogramSettings& settings() const { return settings_; }
  // name "spd", quantity "counts", unit "ps"
  Axis axis() const;

 private:
  void count(std::span<const Tag> tags);
  void count_singly(std::span<const Tag> tags);
  void count_removed();
  void add_marker(const Tag& tag);
  void commit(std::size_t tags);

  HistogramSettings settings_;
  StartGaps gaps_;
  TagFilter filter_;
  ClickBins click_bins_;
  TagRun run_;         // accumulators of one add(); reset by commit()
  bool fresh_ = true;  // run_.last_time_ps is not valid yet
  bool has_start_ = false;
  bool in_overflow_ = false;
  std::vector<std::uint32_t> bins_;  // the axis, then one cell per other category
  TagCounts totals_;
};

}  // namespace echofuse::tdc
