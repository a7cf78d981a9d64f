// SPDX-License-Identifier: MIT
// The timetable says what goes wrong in a laboratory, and when; every run of the laboratory repeats
// it.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::sim {

enum class FaultKind : std::uint8_t {
  drop,
  corrupt,
  stall,
  late,
  unplug,
  garbage,
  clock_drift,
  clock_offset,
  gain,
  freeze,
};
inline constexpr std::size_t fault_kinds = 10;
const char* name_of(FaultKind kind);

// A fault acts from at_s for for_s seconds of the laboratory's time, and again every every_s if
// that is not 0. `amount` means, for drop and corrupt, a share of the blocks or frames; for late,
// s; for garbage, bytes with each block or frame (for a camera a share of the frames); for
// clock_drift, ppm; for clock_offset, s; for gain, a factor.
struct Fault {
  std::string device;  // tdc, radar, depth
  FaultKind kind{};
  double at_s = 0, for_s = 0, every_s = 0, amount = 0;
};

// The text holds [[fault]] tables. Throws Error(config) that lists every mistake as
// name:line:column.
std::vector<Fault> read_faults(const std::string& text, const std::string& name);

// Faults of one device, as functions of the laboratory's time. Threading: one thread may use it, as
// even the const members keep a value.
class Faults {
 public:
  Faults() = default;
  Faults(const std::vector<Fault>& all, const std::string& device);

  bool empty() const { return faults_.empty(); }
  // Returns the amount of the fault of this kind that acts at this time.
  std::optional<double> at(FaultKind kind, double time_s) const;
  bool any_at(double time_s) const;
  // Returns the time of the next change after time_s; infinity if there is none.
  double next_change_s(double time_s) const;
  // Seconds that the device's clock is ahead. Drift gained stays after the fault ends.
  double clock_error_s(double time_s) const;

  struct Change {
    double time_s;
    const Fault* fault;
    bool begins;
  };
  // Returns the changes in (from_s, to_s], sorted by time.
  std::vector<Change> changes(double from_s, double to_s) const;

 private:
  // State of the faults between two changes; asked for every tag.
  struct Segment {
    double from_s = 0, to_s = 0;    // none yet: empty
    double error_s = 0, slope = 0;  // error of the clock at from_s (s), and its slope
    std::array<std::optional<double>, fault_kinds> amounts{};
  };
  const Segment& segment(double time_s) const;
  Segment segment_at(double time_s) const;

  std::vector<Fault> faults_;
  mutable Segment segment_;
};

}  // namespace echofuse::sim
