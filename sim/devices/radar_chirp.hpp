// SPDX-License-Identifier: MIT
// Parameters of a configured chirp, as TI's demo firmware derives them from its CLI commands
// (mmwave SDK 3.x, mmwdemo_rfparser.c), and the range profile of the chirp.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Chirp {
  double start_ghz = 0, idle_us = 0, adc_start_us = 0, ramp_end_us = 0;
  double slope_mhz_us = 0, sample_rate_ksps = 0;
  unsigned samples = 0;
  unsigned antennas = 0;                 // virtual antennas: receivers times transmitters
  unsigned receivers = 0;                // bit mask
  std::vector<unsigned> transmitters{};  // from 0, in chirp order
  unsigned chirps_per_frame = 0;
  unsigned frames = 0;  // 0: unlimited
  double frame_period_ms = 0;

  bool operator==(const Chirp&) const = default;

  // Returns true if the front end accepts the chirp. It truncates the start frequency (unit 2.7 GHz
  // / 2^26), the slope (900 of these per microsecond) and the times (unit 10 ns) to whole numbers.
  bool possible() const;
  bool ramp_possible() const;  // same, for the ramp alone
  double active_us() const;    // active time of a frame
  double played_slope_mhz_us() const;
  // bins = samples rounded up to a power of two (1022 for 1024 bins and 12 antennas),
  // step = c fs / (2 slope bins), resolution = c / 2B with B = slope samples / fs, with the
  // slope that the chip plays. The response is that of the conditions, over these cells.
  RadarAxis axis(const Conditions& conditions) const;
  // The firmware's own step: 3e8 fs / (2 slope bins), by the slope of the profileCfg.
  double firmware_step_m() const;
};

// Codes of one frame's TLV 2: log2_q8(sum_a log2 |x_a|), |x_a| >= 1, over the virtual antennas a.
// Each has
//   |x_a| = g sqrt(P + N)
// with the noise-free power P (radar_power), the frame's noise N (add_frame_noise) and the gain g
// from power to the chip's integers. The mean over a slot's frames then has the noise of a data
// set's profile.
std::vector<std::uint16_t> range_profile_codes(const std::vector<double>& power, double mean_peak,
                                               unsigned antennas, const Conditions& conditions,
                                               Rng& rng);
inline constexpr double radar_gain = 1 << 20;
double log2_level(double magnitude);  // log2 |x_a| of a magnitude, in the chip's integers

// Result of measureRangeBiasAndRxChanPhase: distance of the profile's peak, by the firmware's step,
// from the target's true distance (m). The peak is searched within +-window/2 of the target's bin
// and interpolated by a parabola over three magnitudes.
double measured_range_bias_m(const std::vector<double>& power, double step_m, double target_m,
                             double window_m);

}  // namespace echofuse::sim
