// SPDX-License-Identifier: MIT
// Checks a time tagger's stream, and repairs two faults. Pure.
//   wrap         times restart at 2^32 or 2^40 ps: continued
//   order        an event is up to 1 us earlier than its predecessor: sorted. Therefore events of
//   the last 1 us of a block wait for the next block, in the first second and after any disorder
//   back         other steps back
//   clock        the device's clock runs at another rate than the host's
//   overflow     an overflow does not end
//   missing      gaps of several laser periods between starts, without a conditional filter
//   doubled      a start is followed by a second one within its period
//   period       the laser's period changes
//   steps        the step of the tags does not divide the bin width
//   second       a click is followed by a second one after a fixed time
// The last five faults are tested on the first 20,000 events of each second.
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/sample.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

// Returns a warning that bins are uneven for tags in steps of `step_ps`, with a suitable bin width;
// empty if they are even.
std::string comb_text(long double step_ps, std::int64_t bin_width_ps);

class TagCheck {
 public:
  using ReportFault = std::function<void(const std::string&)>;
  // `live`: reports each fault immediately, and tests the device's clock. For a recording, time is
  // that of its tags.
  TagCheck(const tdc::HistogramSettings& use, bool live, ReportFault report);

  using Output = std::function<void(const TagBlock&)>;
  // Calls `out` with the waiting events, then with those of the block; times are repaired.
  void take(const TagBlock& block, const Output& out);
  // Calls `out` with the remaining events at the end of the stream.
  void flush(const Output& out);
  // Reports faults not reported yet, and the counts of repeated ones.
  void finish();

 private:
  enum FaultType {
    wrap,
    order,
    back,
    clock,
    overflow,
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
  struct SecondCounts {  // counts of the current second
    std::size_t events = 0;
    std::uint64_t starts = 0, firsts = 0, seconds = 0;
    std::vector<std::uint64_t> gaps_ps, delays_ps;  // between starts; from first to second click
    std::uint64_t step_ps = 0;
  };

  bool is_plain(const TagBlock& block) const;
  bool in_order(const TagBlock& block) const;
  void repair(Tag& tag);
  void sort();
  std::size_t ready() const;
  // `plain`: the result of is_plain().
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
  std::optional<std::uint64_t> last_ps_;  // as sent by the device
  std::uint64_t highest_ps_ = 0, offset_ps_ = 0;
  // Counts of the current second.
  std::uint64_t wrapped_ = 0, stepped_back_ = 0, sorted_ = 0, farthest_back_ps_ = 0;
  unsigned wrap_bits_ = 0;
  struct ClockReading {
    HostTime received;
    std::uint64_t device_ps;
  };
  std::optional<ClockReading> clock_from_;
  std::optional<double> clock_ratio_;
  std::optional<HostTime> second_from_, overflow_from_;
  bool overflow_told_ = false;
  std::optional<std::uint64_t> last_start_ps_, last_click_ps_;
  unsigned clicks_ = 0;  // since the last start
  SecondCounts sample_;
  double period_ps_ = 0;   // start period; 0: unknown
  double next_share_ = 0;  // share of starts followed by the start of the next pulse
};

}  // namespace echofuse::acquire
