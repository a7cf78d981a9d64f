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

// How many of the laser's pulses a time tagger passes on. A conditional filter keeps the starts
// that have no click in the device, so clicks a start say nothing of how bright the light is; the
// gaps between starts do. Pure.
class StartGaps {
 public:
  explicit StartGaps(std::int32_t start_channel) : channel_(start_channel) {}

  // The first 100,000 gaps are looked at.
  void add(std::span<const Tag> tags);
  // Tags are missing in between.
  void forget_start() { has_last_ = false; }
  // Share of the pulses whose start arrives: of the starts, those that the laser's next pulse
  // follows. 1 without a filter; with one, the chance of a click, as no pulse knows of another.
  // Below 0.5 % it is too high, but stays near 1 %. None if fewer than 20 starts are followed so.
  std::optional<double> share() const;
  // Clicks a laser pulse, of so many clicks and starts that came; none if the share is not known.
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
  // For taggers that do neither by themselves (tag_filter.hpp).
  std::int64_t click_delay_ps = 0, dead_time_ps = 0;
};

class Histogram {
 public:
  // Throws Error(config): no bins (or above 2^24), a bin width below 1 ps, start and click channel
  // alike, or an axis longer than 2^50 ps.
  // A dead time below 0, or a delay of more than 1 ms.
  explicit Histogram(const HistogramSettings& settings);

  void add(std::span<const Tag> tags);
  // Counts what waits for its order among delayed tags.
  void flush();
  // Tags were lost in between (a gap in the transport, a new connection). Whether an overflow lasts
  // is unknown then; the next marker tells.
  void forget_start();
  // Both are since the last clear(). counts() has `bins` entries.
  std::vector<std::uint32_t> counts() const;
  TagCounts tag_counts() const { return totals_; }
  // The last start survives.
  void clear();
  // counts() and then clear().
  std::vector<std::uint32_t> take();
  // Goes on behind the tags of `before`, which is flushed: the last start survives the border of
  // slots.
  void follow(Histogram& before);
  // Gaps between the starts as they came, from the beginning on.
  const StartGaps& gaps() const { return gaps_; }

  bool in_overflow() const { return in_overflow_; }  // clicks do not count

  const HistogramSettings& settings() const { return settings_; }
  // name "spd", quantity "counts", unit "ps"
  Axis axis() const;

 private:
  void count(std::span<const Tag> tags);
  void count_singly(std::span<const Tag> tags);
  void count_removed();
  void add_marker(const Tag& tag);
  void settle(std::size_t tags);

  HistogramSettings settings_;
  StartGaps gaps_;
  TagFilter filter_;
  ClickBins click_bins_;
  TagRun run_;         // accumulators of one add(); settle() zeroes them
  bool fresh_ = true;  // run_.last_time_ps says nothing
  bool has_start_ = false;
  bool in_overflow_ = false;
  std::vector<std::uint32_t> bins_;  // the axis, then one cell for each way not to be on it
  TagCounts totals_;
};

}  // namespace echofuse::tdc
