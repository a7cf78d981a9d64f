// SPDX-License-Identifier: MIT
// Converts a device's clock to the host's clock.
//
// A sample has the device time d of its measurement and the host time h of its receipt: h = taken +
// delay, with delay >= 0 and a long tail (buffers, scheduling). So the line taken = a + b d is on
// or below every h, and the least delayed samples touch it. The history holds the least
// delayed sample of each half second, for 128 s. The line extends an edge of the lower convex hull
// of these samples. The edge at the middle of the history minimises the total delay (a linear
// programme, Zhang et al., INFOCOM 2002). The slope is limited to 500 ppm. In the first 32 s the
// limit is proportional to the elapsed time, because a few late samples then look like a drift. A
// late sample does not affect the fit.
//
// Limit: a constant transport delay (cable, processing in the radar, exposure of a camera) cannot
// be separated from a clock offset. It remains in `offset_s`, and "taken" is late by that delay,
// unless there is another reference.
//
// The history restarts if the device's clock does:
//   gap    no samples for 10 s, which also keeps a counter of 21 s unambiguous
//   jump   two consecutive samples that agree with each other, but were received 0.25 s before
//   their measurement, or go back by more than 1 s. A single one is a damaged time: not used,
//   counted.
//   step   all samples of 3 s, at least 10, are late by more than 0.1 s
//   reset  called after the reconnection of a radar, because its counter wraps too often to detect
//   it
#pragma once
#include <cstdint>
#include <deque>
#include <optional>

#include "acquire/record/fused_record.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

// Returns the ticks between two readings of a device's counter: among all values compatible with a
// counter of 64 - `spare_bits` bits, the one nearest to `expected`.
std::int64_t ticks_passed(std::uint64_t from, std::uint64_t to, double expected,
                          unsigned spare_bits);

class ClockFit {
 public:
  // `tick_s`: length of a tick; `bits`: width of the device's counter.
  explicit ClockFit(double tick_s, unsigned bits = 64) : tick_s_(tick_s), spare_bits_(64 - bits) {}

  // Call in order of receipt.
  void add(std::uint64_t ticks, HostTime received);

  // Returns true if there are enough samples (32, over at least 0.5 s), the latest one is not
  // suspect, and the device's clock runs at the host's rate within 5 %.
  bool sound() const;
  // Returns the host time of the measurement, at most the time of receipt. Returns the time of
  // receipt without a sound fit.
  HostTime taken(std::uint64_t ticks, HostTime received) const;
  // Returns the state of the fit; nothing without a sound fit.
  std::optional<record::ClockState> state(HostTime at) const;

 private:
  struct Receipt {
    std::uint64_t ticks = 0;
    HostTime received{};
  };
  struct ClockSample {
    double device_s;  // since the start of the history
    double excess_s;  // host time since the start, minus device_s
  };
  struct Least {  // least delayed sample of a stretch of the history
    ClockSample sample;
    std::int64_t stretch;
    std::uint64_t samples;
  };
  struct Late {
    HostTime since;
    unsigned samples;
  };

  void begin(const Receipt& receipt);
  std::int64_t advance(const Receipt& from, const Receipt& to) const;
  ClockSample sample_of(const Receipt& receipt) const;
  bool agree(const Receipt& first, const Receipt& second) const;
  double line(double device_s) const { return intercept_s_ + slope_ * device_s; }
  bool jumps(const ClockSample& sample) const;
  bool steps(const ClockSample& sample, HostTime received);
  void take(const ClockSample& sample);
  void fit();

  double tick_s_;
  unsigned spare_bits_;
  HostTime began_{};
  double first_s_ = 0;           // device counter at the start of the history
  Receipt last_;                 // last sample used
  std::int64_t last_ticks_ = 0;  // its device time since the start of the history
  double newest_s_ = 0;
  std::deque<Least> history_;  // empty: no samples yet
  std::uint64_t samples_ = 0;  // number of samples in the history
  double intercept_s_ = 0, slope_ = 0, residual_s_ = 0;
  double edge_slope_ = 0;  // slope before limiting
  std::optional<Receipt> suspect_;
  std::optional<Late> late_;
};

// Device time of a histogram in the tagger's ps, modulo 2^64.
inline std::uint64_t device_clock_of(const HistogramFrame& frame) {
  return 1'000'000 * frame.device_time_us;
}

// Clocks of the three sensors.
class SensorClocks {
 public:
  void observe(const TagBlock& block);
  void observe(const HistogramFrame& frame);
  void observe(const RadarFrame& frame);
  void observe(const DepthFrame& frame);
  const ClockFit& operator[](Sensor s) const { return fits_[s]; }

 private:
  ClockFit& of(Sensor s) { return fits_[s]; }

  // Tags in ps, the radar's CPU cycles at 200 MHz, the camera's microseconds.
  PerSensor<ClockFit> fits_{ClockFit(1e-12), ClockFit(5e-9, 32), ClockFit(1e-6)};
};

}  // namespace echofuse::acquire
