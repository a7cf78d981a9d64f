// SPDX-License-Identifier: MIT
// Limits of the chip's front end (xWR6x43): ramps and frames that it takes. The board answers
// sensorStart with a bare "Error -1" to any other.
//
// The demo's command line passes whole steps to the front end, truncated towards 0. On 60 GHz parts
// a step is
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

  Ramp in_steps() const;            // as the front end has it
  double sampled_until_us() const;  // end of the last sample
  double carrier_hz() const;        // centre of the sampled sweep
};

// Limits that the ramp, in the chip's steps, exceeds, with the numbers.
std::vector<std::string> refusals_of(const Ramp& ramp);
// The same for a frame with this number of chirps, which take active_ms in all.
std::vector<std::string> frame_refusals_of(double chirps, double active_ms, double period_ms);
constexpr const char* front_end_limits =
    "sweeps within 60 to 64 GHz, samples within the ramp, chirps within the frame's period, and "
    "this from 0.3 to 1342 ms; each chirp of the frame needs its chirpCfg and profileCfg";

}  // namespace echofuse::radar
