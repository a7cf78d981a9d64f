// SPDX-License-Identifier: MIT
// Parameters and range profile of a chirp. The parameters are computed from the CLI commands as in
// TI's demo firmware (mmWave SDK 3.x, mmwdemo_rfparser.c).
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
  unsigned antennas = 0;                 // number of virtual antennas: receivers times transmitters
  unsigned receivers = 0;                // bit mask of the receivers
  std::vector<unsigned> transmitters{};  // transmitter indices from 0, in chirp order
  unsigned chirps_per_frame = 0;
  unsigned frames = 0;  // number of frames to send; 0: unlimited
  double frame_period_ms = 0;

  bool operator==(const Chirp&) const = default;

  // Returns true if the front end accepts the frame. The front end truncates values to whole
  // register units: 2.7 GHz / 2^26 for the start frequency, 900 * 2.7 GHz / 2^26 per microsecond
  // for the slope, and 10 ns for times.
  bool possible() const;
  bool ramp_possible() const;  // true if the front end accepts the frequency ramp
  double active_us() const;    // time in a frame during which chirps are sent
  // Slope that the chip generates: slope_mhz_us truncated to whole register units.
  double played_slope_mhz_us() const;
  // Returns the range axis for the generated slope and the sample rate fs:
  //   bins = samples, rounded up to a power of two (1022 instead of 1024 for 12 antennas)
  //   step = c fs / (2 slope bins)
  //   resolution = c / 2B, with B = slope samples / fs
  // The conditions determine the shape of the response.
  RadarAxis axis(const Conditions& conditions) const;
  // Range step that the firmware computes from the slope of the profileCfg: 3e8 fs / (2 slope
  // bins).
  double firmware_step_m() const;
};

// Returns the range profile codes of one frame (TLV 2): log2_q8(sum_a log2 |x_a|), |x_a| >= 1,
// summed over the virtual antennas a. Each antenna has the magnitude
//   |x_a| = g sqrt(P + N)
// with the noise-free power P (radar_power), the noise power N of the frame (add_frame_noise), and
// the gain g = radar_gain to the integers of the chip. The mean over the frames of a slot then has
// the same noise as a profile of a data set.
std::vector<std::uint16_t> range_profile_codes(const std::vector<double>& power, double mean_peak,
                                               unsigned antennas, const Conditions& conditions,
                                               Rng& rng);
inline constexpr double radar_gain = 1 << 20;
double log2_level(double magnitude);  // log2(radar_gain * magnitude), at least 0

// Returns the range bias in the result of measureRangeBiasAndRxChanPhase, m: range of the profile
// peak, computed with the range step of the firmware, minus target_m. The peak is searched within
// +-window_m / 2 of the target, and interpolated by a parabola through three magnitudes.
double measured_range_bias_m(const std::vector<double>& power, double step_m, double target_m,
                             double window_m);

}  // namespace echofuse::sim
