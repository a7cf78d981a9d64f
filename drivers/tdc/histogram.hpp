// SPDX-License-Identifier: MIT
// Counts time tags in a histogram of the time from the last start to each click.
//
// Every click counts once, relative to the LAST start before it (as in the FPGA of Swabian's Time
// Tagger X link reference). The vendor's software Histogram is multiple-start, multiple-stop: it
// counts a click once for EVERY earlier start that is still in range. If there is at most one start
// per range (laser period > first_bin + bins * bin_width), both methods give the same result.
//
// After an error or overflow marker the last start is not valid, because time information is
// missing. Clicks have no start until the next start arrives. Between overflow_begin and
// overflow_end, starts are counted but not assigned to clicks, because tags may be missing there
// (according to the vendor).
//
// Tags with an unknown type or a reserved byte other than 0 are counted and otherwise ignored. A
// time tag that is earlier than its predecessor is counted as `backwards` and used unchanged: a
// click before its start is out of range. Time differences are modulo 2^64.
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

// Estimates the fraction of laser pulses for which a time tagger transfers a start. If the tagger
// uses a conditional filter, it drops starts that are not followed by a click. The number of clicks
// per start then does not depend on the light level, but the gaps between starts do.
class StartGaps {
 public:
  explicit StartGaps(std::int32_t start_channel) : channel_(start_channel) {}

  // Records the gaps between starts, up to 100,000 in total.
  void add(std::span<const Tag> tags);
  // Must be called if tags are missing, because the gap to the next start would be too long.
  void forget_start() { has_last_ = false; }
  // Returns the fraction of pulses for which a start is transferred. It equals the fraction of
  // starts that are followed by the start of the next pulse. Without a filter, it is 1. With a
  // filter, it is the probability of a click, because pulses are independent. Fractions below 0.5 %
  // are overestimated as about 1 %. Returns nullopt if fewer than 20 starts are followed by the
  // start of the next pulse.
  std::optional<double> share() const;
  // Returns the number of clicks per laser pulse, computed from the number of clicks and the number
  // of transferred starts. Returns nullopt if share() returns nullopt.
  std::optional<double> clicks_per_pulse(std::uint64_t clicks, std::uint64_t starts) const;

 private:
  std::int32_t channel_;
  bool has_last_ = false;
  std::uint64_t last_ps_ = 0;
  std::vector<std::int64_t> gaps_ps_;
};

// The defaults cover two-way times that correspond to ranges from 2.0 m to 7.04 m.
struct HistogramSettings {
  std::int32_t start_channel = 1;  // channel of the laser sync signal
  std::int32_t click_channel = 2;  // channel of the detector
  std::int64_t bin_width_ps = 100;
  // two-way time at the start of bin 0; may be negative because of cable delays
  std::int64_t first_bin_ps = 13343;
  std::uint32_t bins = 336;
  // used for taggers that cannot delay clicks or apply a dead time (tag_filter.hpp)
  std::int64_t click_delay_ps = 0, dead_time_ps = 0;
};

class Histogram {
 public:
  // Throws Error(config) if the number of bins is 0 or above 2^24, the bin width is below 1 ps,
  // start and click have the same channel, the axis is longer than 2^50 ps, the dead time is not
  // between 0 and 1 ms, or the delay exceeds 1 ms.
  explicit Histogram(const HistogramSettings& settings);

  void add(std::span<const Tag> tags);
  // Counts the tags that are still held back because of the click delay.
  void flush();
  // Must be called if tags were lost (transport gap, new connection). The overflow state is then
  // unknown until the next overflow marker.
  void forget_start();
  // counts() and tag_counts() return the counts since the last clear(). counts() has `bins`
  // entries.
  std::vector<std::uint32_t> counts() const;
  TagCounts tag_counts() const { return totals_; }
  // Resets the counts but keeps the last start.
  void clear();
  // Returns counts() and then calls clear().
  std::vector<std::uint32_t> take();
  // Continues the tag stream of `before`, which is flushed. The last start therefore remains valid
  // from one slot to the next.
  void follow(Histogram& before);
  // Returns the gaps between starts recorded since this object was created.
  const StartGaps& gaps() const { return gaps_; }

  bool in_overflow() const { return in_overflow_; }  // clicks count as without_start

  const HistogramSettings& settings() const { return settings_; }
  // Returns the axis with name "spd", quantity "counts" and unit "ps".
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
  TagRun run_;         // accumulators of one add() call; reset by commit()
  bool fresh_ = true;  // true until run_.last_time_ps is valid
  bool has_start_ = false;
  bool in_overflow_ = false;
  std::vector<std::uint32_t> bins_;  // one element per bin, then one element per ExtraCell
  TagCounts totals_;
};

}  // namespace echofuse::tdc
