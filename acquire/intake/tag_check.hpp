// SPDX-License-Identifier: MIT
// Checks the event stream of a time tagger for the following faults, and repairs the first two
// kinds. Uses no clock, device or file.
//   wrap         times restart at 2^32 or 2^40 ps; an offset is added to the later times
//   order        an event is up to 1 us earlier than its predecessor; events are sorted. For this,
//                events in the last 1 us of a block wait for the next block, in the first second
//                and after any event out of order
//   back         times go back for another reason
//   clock        the device clock runs at another rate than the host clock
//   overflow     an overflow does not end within 3 s
//   invalid      tags have an unknown type or a nonzero reserved byte
//   missing      gaps between starts are several laser periods long, but starts are not filtered
//   doubled      a start is followed by a second start within its period
//   period       the laser period changes
//   steps        the bin width is not a multiple of the time step of the tags
//   second       a click is followed by a second click after a fixed time, or at the same time
// The last five faults are tested on the first 20,000 events of each second.
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/intake/clock_rate.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

std::string rate_text(double hz);  // e.g. "78.1 kHz"

// Returns a warning that recommends a bin width if tag times in multiples of `step_ps` make the
// bins uneven; otherwise an empty string.
std::string comb_text(long double step_ps, std::int64_t bin_width_ps);

class TagCheck {
 public:
  using ReportFault = std::function<void(const std::string&)>;
  // If `live` is true, reports each fault immediately and checks the device clock. A recording is
  // not live, because its arrival times are derived from its tags.
  TagCheck(const tdc::HistogramSettings& use, bool live, ReportFault report);

  using Output = std::function<void(const TagBlock&)>;
  // Calls `out` with the events that waited for this block, then with the events of the block. The
  // times of all these events have been repaired.
  void take(const TagBlock& block, const Output& out);
  // Calls `out` with the events that are still waiting. Must be called at the end of the stream.
  void flush(const Output& out);
  // Reports the faults that have not been reported yet, and the counts of repeated faults.
  void finish();

 private:
  enum FaultType {
    wrap,
    order,
    back,
    clock,
    overflow,
    invalid,
    missing,
    doubled,
    period,
    steps,
    second,
    kinds
  };
  struct TagFault {
    std::uint64_t count = 0, reported = 0;
    std::string cause;
  };
  struct SecondCounts {  // statistics of the first 20,000 events in each second
    std::size_t events = 0;
    std::uint64_t starts = 0, firsts = 0, seconds = 0;
    // Gaps between starts; delays from the first to the second click after a start.
    std::vector<std::uint64_t> gaps_ps, delays_ps;
    std::uint64_t step_ps = 0;
  };

  bool is_plain(const TagBlock& block) const;
  bool in_order(const TagBlock& block) const;
  void repair(Tag& tag);
  void sort();
  std::size_t ready() const;
  // Checks the events and calls `out` with them. `plain` is the result of is_plain().
  void pass(const TagBlock& block, const Output& out, bool plain = false);
  void check_tag(const Tag& tag, HostTime received);
  void take_marker(const Tag& tag, HostTime received);
  void check_clock(HostTime received);
  void check_overflow(HostTime received);
  void check_starts();
  void check_clicks();
  void check_second(HostTime received);
  void found(FaultType kind, std::uint64_t count, const std::string& cause);
  void report(FaultType kind);

  tdc::HistogramSettings use_;
  bool live_;
  ReportFault report_;
  std::array<TagFault, kinds> faults_;
  std::vector<Tag> repaired_, held_;
  HostTime held_received_{};
  bool hold_ = true;
  std::optional<std::uint64_t> last_ps_;  // last time as sent by the device, without repair
  std::uint64_t highest_ps_ = 0, offset_ps_ = 0;
  // Counts of the faults in the current second.
  std::uint64_t wrapped_ = 0, stepped_back_ = 0, sorted_ = 0, invalid_ = 0, farthest_back_ps_ = 0;
  unsigned wrap_bits_ = 0;
  ClockRate clock_{1e-12};
  std::optional<HostTime> second_from_, overflow_from_;
  bool overflow_reported_ = false;
  std::optional<std::uint64_t> last_start_ps_, last_click_ps_;
  unsigned clicks_ = 0;  // number of clicks since the last start
  SecondCounts sample_;
  double period_ps_ = 0;   // period of the starts; 0 if unknown
  double next_share_ = 0;  // fraction of starts that are followed by the start of the next pulse
};

}  // namespace echofuse::acquire
