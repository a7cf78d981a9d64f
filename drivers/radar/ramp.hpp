// SPDX-License-Identifier: MIT
// Limits of the chip's front end (xWR6x43) for ramps and frames. If a limit is exceeded, the
// board answers sensorStart with "Error -1" without a reason.
//
// The demo's command line converts values to integer steps, truncated towards 0. On 60 GHz parts a
// step is
//   start frequency  2.7 GHz / 2^26 = 40.2 Hz
//   slope            2.7 GHz * 900 / 2^26 a microsecond = 36.21 kHz/us
//   times            10 ns
// (mmWave SDK 3.4, ti/utils/cli/src/cli_mmwave.c; ti/control/mmwavelink, rlProfileCfg_t). So
// 45 MHz/us over 88.89 us from 60 GHz ends at 63.998 GHz, not at 64.00005 GHz.
#pragma once
#include <string>
#include <vector>

namespace echofuse::radar {

struct Ramp {
  double start_ghz = 0, idle_us = 0, adc_start_us = 0, end_us = 0, slope_mhz_us = 0;
  double samples = 0, rate_ksps = 0;

  // Returns the ramp with its values rounded towards 0 to the chip's step sizes.
  Ramp in_steps() const;
  double sampled_until_us() const;  // time of the last sample
  double carrier_hz() const;        // centre frequency of the sampled sweep
  // Returns the range between adjacent points of a range FFT with `points` points:
  //   c * sample rate / (2 * slope * points)
  // The slope is rounded to the chip's step. TI's demo and documents use c = 3.0e8 m/s and
  // the slope of the cfg instead. If `points` is the number of samples, the result is the range
  // resolution c / 2B.
  double range_step_m(double points) const;
};

// Returns one message for each limit that the ramp exceeds. The limits are checked after rounding
// to the chip's steps.
std::vector<std::string> refusals_of(const Ramp& ramp);
// Returns a value rounded to a multiple of `unit`, for messages.
std::string digits(double value, double unit = 1e-3);
constexpr const char* front_end_limits =
    "sweeps within 60 to 64 GHz, samples within the ramp, chirps within the frame's period, and "
    "a period of 0.3 to 1342 ms; each chirp of the frame needs its chirpCfg and profileCfg";

}  // namespace echofuse::radar
