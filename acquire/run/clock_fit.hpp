// SPDX-License-Identifier: MIT
// A device's clock -> the host's clock.
//
// A sample bears the device's time d at which it was taken and the host's time h at which it was
// read: h = taken + delay, delay >= 0 with a long tail (buffers, scheduling). So taken = a + b d
// lies on or below every h, and the earliest samples touch it. Kept is the least delayed sample of
// every half second of the last 128 s; of the edges of their lower convex hull the one below the
// middle of the history is the line that leaves the least delay in all (a linear programme, Zhang
// et al., INFOCOM 2002). It is no steeper than 500 ppm, and in the first 32 s no steeper than the
// share of them that has passed: so early a few late samples look like a drift. A late sample,
// however late, moves nothing.
//
// What cannot be known: a delay that every sample has (the way through a cable, a radar's
// processing, a camera's exposure) is the same as an offset of the clocks. It stays in `offset_s`,
// and "taken" is late by it, unless another reference tells.
//
// The history begins anew where the device's clock does:
//   gap    nothing for 10 s, which is also what keeps a counter of 21 s unambiguous
//   jump   two samples in a row that agree with each other, but were read 0.25 s before they were
//          taken, or go back by more than 1 s. A single one is a damaged time: not used, counted.
//   step   all samples of 3 s, at least 10, are late by more than 0.1 s
//   reset  the caller knows (reconnection of a radar, whose counter wraps too soon to tell)
#pragma once
#include <cstdint>
#include <deque>
#include <optional>

#include "acquire/record/record.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

// Ticks from one reading of a device's counter to the other; of all that 64 less `spare_bits` bits
// allow, those nearest to the expected.
std::int64_t ticks_passed(std::uint64_t from, std::uint64_t to, double expected,
                          unsigned spare_bits);

class ClockFit {
 public:
  // The device counts ticks of this length in a counter of this many bits.
  explicit ClockFit(double tick_s, unsigned bits = 64) : tick_s_(tick_s), spare_bits_(64 - bits) {}

  // Call in the order of receipt.
  void add(std::uint64_t ticks, HostTime received);

  // Enough samples (32, over at least 0.5 s), the latest is not a doubtful one, and the device's
  // clock runs at the host's rate within 5 %.
  bool sound() const;
  // Host time at which the sample was taken, never after its receipt. Equals the receipt without a
  // sound fit.
  HostTime taken(std::uint64_t ticks, HostTime received) const;
  // State of the fit; none without a sound fit.
  std::optional<record::ClockState> state(HostTime at) const;

 private:
  struct Receipt {
    std::uint64_t ticks = 0;
    HostTime received{};
  };
  struct Sample {
    double device_s;  // since the history began
    double excess_s;  // the same on the host's clock, minus device_s
  };
  struct Least {  // delayed sample of a stretch of the history
    Sample sample;
    std::int64_t stretch;
    std::uint64_t samples;
  };
  struct Late {
    HostTime since;
    unsigned samples;
  };

  void begin(const Receipt& receipt);
  std::int64_t advance(const Receipt& from, const Receipt& to) const;
  Sample sample_of(const Receipt& receipt) const;
  bool agree(const Receipt& first, const Receipt& second) const;
  double line(double device_s) const { return intercept_s_ + slope_ * device_s; }
  bool jumps(const Sample& sample) const;
  bool steps(const Sample& sample, HostTime received);
  void take(const Sample& sample);
  void fit();

  double tick_s_;
  unsigned spare_bits_;
  HostTime began_{};
  double first_s_ = 0;           // on the device's counter when the history began
  Receipt last_;                 // that was used
  std::int64_t last_ticks_ = 0;  // its device time since the history began
  double newest_s_ = 0;
  std::deque<Least> history_;  // empty: nothing was observed yet
  std::uint64_t samples_ = 0;  // that the history stands for
  double intercept_s_ = 0, slope_ = 0, residual_s_ = 0;
  double edge_slope_ = 0;  // before it is limited
  std::optional<Receipt> suspect_;
  std::optional<Late> late_;
};

// Device time of a histogram in the tagger's ps, modulo 2^64.
inline std::uint64_t device_clock_of(const HistogramFrame& frame) {
  return 1'000'000 * frame.device_time_us;
}

// The clocks of the three sensors.
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
