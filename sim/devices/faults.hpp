// SPDX-License-Identifier: MIT
// Schedule of the faults in a laboratory. Time zero is the start of the laboratory.
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

// Fault that starts `at_s` seconds after the start of the laboratory and lasts `for_s` seconds. It
// repeats every `every_s` seconds; if `every_s` is 0, it occurs only once. Units of `amount`:
//   drop, corrupt  fraction of blocks or frames
//   late           delay, s
//   garbage        bytes per block or radar frame; camera: fraction of frames
//   clock_drift    ppm
//   clock_offset   s
//   gain           factor
struct Fault {
  std::string device;  // name of the device: tdc, radar or depth
  FaultKind kind{};
  double at_s = 0, for_s = 0, every_s = 0, amount = 0;
};

// Parses TOML text with [[fault]] tables. Throws Error(config) with all mistakes, each on a line of
// the form "name:line:column: mistake".
std::vector<Fault> read_faults(const std::string& text, const std::string& name);

// Faults of one device as functions of laboratory time. Threading: must be used from one thread
// only, because const member functions update a cache.
class Faults {
 public:
  Faults() = default;
  Faults(const std::vector<Fault>& all, const std::string& device);

  bool empty() const { return faults_.empty(); }
  // Returns the amount of the fault of this kind active at `time_s`; empty if no such fault is
  // active.
  std::optional<double> at(FaultKind kind, double time_s) const;
  bool any_at(double time_s) const;
  // Returns the first time after `time_s` at which a fault starts or ends; infinity after the last
  // change.
  double next_change_s(double time_s) const;
  // Returns the offset of the device clock from laboratory time, s; positive if the device clock is
  // ahead. An offset accumulated by drift remains after the fault.
  double clock_error_s(double time_s) const;

  struct FaultChange {
    double time_s;
    const Fault* fault;
    bool begins;
  };
  // Returns the starts and ends of faults in (from_s, to_s], in chronological order.
  std::vector<FaultChange> changes(double from_s, double to_s) const;

 private:
  // State between two successive fault changes. The state is cached, because it is used for each
  // tag.
  struct Segment {
    double from_s = 0, to_s = 0;    // time range of the segment, s; empty before the first use
    double error_s = 0, slope = 0;  // clock offset at from_s, in s, and clock drift, in s/s
    std::array<std::optional<double>, fault_kinds> amounts{};
  };
  const Segment& segment(double time_s) const;
  Segment segment_at(double time_s) const;

  std::vector<Fault> faults_;
  mutable Segment segment_;
};

}  // namespace echofuse::sim
