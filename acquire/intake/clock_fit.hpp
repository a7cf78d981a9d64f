// SPDX-License-Identifier: MIT
// Converts times of a device's clock to times of the host's clock.
//
// A sample has the device time d of its measurement and the host time h of its receipt: h = taken +
// delay, with delay >= 0 and a long tail (buffers, scheduling). So the line taken = a + b d is on
// or below every h, and the least delayed samples touch it. The history contains the least delayed
// sample of each half second, for 128 s. The line extends an edge of the lower convex hull of these
// samples. The edge at the middle of the history minimises the total delay (a linear programme,
// Zhang et al., INFOCOM 2002). The slope is limited to 500 ppm. In the first 32 s the limit is
// proportional to the elapsed time, because a few late samples then look like a drift. A late
// sample does not affect the fit.
//
// Limit: a constant transport delay (cable, processing in the radar, exposure of a camera) cannot
// be separated from a clock offset. It remains in `offset_s`, and "taken" is late by that delay,
// unless there is another reference.
//
// The history restarts if the device's clock may have restarted:
//   gap    no samples for 10 s, so that a counter that wraps after 21 s remains unambiguous
//   jump   two consecutive samples agree with each other, but according to the fit they were
//          received 0.25 s before their measurement, or their times are more than 1 s earlier than
//          those of previous samples. A single such sample has a damaged time and is not used.
//   step   all samples within 3 s (at least 10 samples) are late by more than 0.1 s
#pragma once
#include <algorithm>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>

#include "acquire/record/fused_record.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

// Returns the number of ticks between two readings of a device counter with 64 - `spare_bits` bits.
// If several numbers are possible, returns the one nearest to `expected`.
std::int64_t ticks_passed(std::uint64_t from, std::uint64_t to, double expected,
                          unsigned spare_bits);

// Returns true if the frames contain neither number nor time: at least eight frames, all equal.
// Otherwise equal frames are copies.
inline constexpr std::size_t unnumbered_frames = 8;
template <class Frames>
bool lacks_numbers(const Frames& frames) {
  return frames.size() >= unnumbered_frames &&
         std::ranges::adjacent_find(frames, std::ranges::not_equal_to()) == frames.end();
}

class ClockFit {
 public:
  // `tick_s` is the duration of a tick, and `bits` the width of the device counter.
  explicit ClockFit(double tick_s, unsigned bits = 64) : tick_s_(tick_s), spare_bits_(64 - bits) {}

  // Adds a sample. Samples must be added in the order in which they arrived.
  void add(std::uint64_t ticks, HostTime received);

  // Returns true if the fit is reliable: it has at least 32 samples over at least 0.5 s, the latest
  // sample is not suspect, and the clock rates of device and host agree within 5 %.
  bool sound() const;
  // Returns the host time of the measurement, which is never later than the arrival time. If the
  // fit is not sound, returns the arrival time.
  HostTime taken(std::uint64_t ticks, HostTime received) const;
  // Returns the state of the fit at a host time; no value if the fit is not sound.
  std::optional<record::ClockState> state(HostTime at) const;

 private:
  struct Receipt {
    std::uint64_t ticks = 0;
    HostTime received{};
  };
  struct ClockSample {
    double device_s;  // device time since the start of the history
    double excess_s;  // host time since the start of the history, minus device_s
  };
  struct IntervalMinimum {  // least delayed sample in a half-second interval of the history
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
  double first_s_ = 0;  // device time at the start of the history
  Receipt last_;
  std::int64_t last_ticks_ = 0;  // device time of last_ since the start of the history, in ticks
  double newest_s_ = 0;
  std::deque<IntervalMinimum> history_;  // empty before the first sample
  std::uint64_t samples_ = 0;
  double intercept_s_ = 0, slope_ = 0, residual_s_ = 0;
  double edge_slope_ = 0;  // fitted slope before clipping; slope_ is the clipped slope
  std::optional<Receipt> suspect_;
  std::optional<Late> late_;
};

// Returns the device time of a histogram, modulo 2^64, in ps, which is the unit of time tags.
inline std::uint64_t device_clock_of(const HistogramFrame& frame) {
  return 1'000'000 * frame.device_time_us;
}

class SensorClocks {
 public:
  void observe(const TagBlock& block);
  void observe(const HistogramFrame& frame);
  void observe(const RadarFrame& frame);
  void observe(const DepthFrame& frame);
  const ClockFit& operator[](Sensor s) const { return fits_[s]; }

 private:
  ClockFit& of(Sensor s) { return fits_[s]; }

  // Tick durations: 1 ps for time tags, 5 ns for the radar's cycles, 1 us for the camera.
  PerSensor<ClockFit> fits_{ClockFit(1e-12), ClockFit(1 / RadarFrame::clock_hz, 32),
                            ClockFit(1e-6)};
};

}  // namespace echofuse::acquire
