// SPDX-License-Identifier: MIT
// Timetable of a laboratory's faults. Time zero is the start of each laboratory.
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

// Active from at_s for for_s seconds of laboratory time, and again every every_s unless that is 0.
// Unit of `amount`: drop and corrupt: share of blocks or frames; late: s; garbage: bytes per block
// or frame (camera: share of frames); clock_drift: ppm; clock_offset: s; gain: factor.
struct Fault {
  std::string device;  // tdc, radar, depth
  FaultKind kind{};
  double at_s = 0, for_s = 0, every_s = 0, amount = 0;
};

// Parses [[fault]] tables. Throws Error(config) that lists each mistake as name:line:column.
std::vector<Fault> read_faults(const std::string& text, const std::string& name);

// Faults of one device as functions of laboratory time. Threading: one thread, because const
// members update a cache.
class Faults {
 public:
  Faults() = default;
  Faults(const std::vector<Fault>& all, const std::string& device);

  bool empty() const { return faults_.empty(); }
  // Returns the amount of the active fault of this kind, or nothing.
  std::optional<double> at(FaultKind kind, double time_s) const;
  bool any_at(double time_s) const;
  // Returns the time of the next change after time_s; infinity after the last one.
  double next_change_s(double time_s) const;
  // Returns how far the device's clock is ahead, s. The drift gained stays after the fault.
  double clock_error_s(double time_s) const;

  struct FaultChange {
    double time_s;
    const Fault* fault;
    bool begins;
  };
  // Returns the changes in (from_s, to_s], sorted by time.
  std::vector<FaultChange> changes(double from_s, double to_s) const;

 private:
  // State between two changes, cached because each tag needs it.
  struct Segment {
    double from_s = 0, to_s = 0;    // empty: no segment yet
    double error_s = 0, slope = 0;  // clock error at from_s (s), and its slope
    std::array<std::optional<double>, fault_kinds> amounts{};
  };
  const Segment& segment(double time_s) const;
  Segment segment_at(double time_s) const;

  std::vector<Fault> faults_;
  mutable Segment segment_;
};

}  // namespace echofuse::sim
