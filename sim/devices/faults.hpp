// SPDX-License-Identifier: MIT
// What goes wrong in a laboratory, and when: a timetable that every run of it repeats.
#pragma once
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
const char* name_of(FaultKind kind);

// From at_s for for_s seconds of the laboratory's time, and again every every_s if that is not 0.
// `amount`: drop, corrupt: share of the blocks or frames; late: s; garbage: bytes with each block
// or frame, of a camera share of the frames; clock_drift: ppm; clock_offset: s; gain: factor.
struct Fault {
  std::string device;  // tdc, radar, depth
  FaultKind kind{};
  double at_s = 0, for_s = 0, every_s = 0, amount = 0;
};

// [[fault]] tables. Throws Error(config) that lists every mistake as name:line:column.
std::vector<Fault> read_faults(const std::string& text, const std::string& name);

// Those of one device, as functions of the laboratory's time.
// Threading: one thread, as even the const clock_error_s() keeps something.
class Faults {
 public:
  Faults() = default;
  Faults(const std::vector<Fault>& all, const std::string& device);

  bool empty() const { return faults_.empty(); }
  // The amount of the fault of this kind that acts at this time.
  std::optional<double> at(FaultKind kind, double time_s) const;
  // How far the device's clock is ahead. What it drifted stays.
  double clock_error_s(double time_s) const;

  struct Change {
    double time_s;
    const Fault* fault;
    bool begins;
  };
  // In (from_s, to_s], by time.
  std::vector<Change> changes(double from_s, double to_s) const;

 private:
  // The clock's error between two changes of its faults. It is asked for every tag.
  struct Segment {
    double from_s = 0, to_s = 0, error_s = 0, slope = 0;  // at from_s; none yet: empty
  };
  Segment segment_at(double time_s) const;

  std::vector<Fault> faults_;
  mutable Segment segment_;
};

}  // namespace echofuse::sim
