// SPDX-License-Identifier: MIT
// What a TI mmWave .cfg file (SDK 3.x) says about the range profile it will produce, and the
// meaning of the profile's numbers.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::radar {

// A line to send: CR stripped, leading spaces kept; blank lines and % comments are not among them.
struct CfgLine {
  int number = 0;  // in the file, from 1
  std::string text;
};
std::vector<CfgLine> command_lines(std::string_view cfg_text);

struct RadarProfile {
  std::uint32_t adc_samples = 0;
  // Next power of two of adc_samples; 1022 for 1024 with 12 antennas (SDK, mss_main.c).
  std::uint32_t bins = 0;
  // 3.0e8 * sample rate / (2 * slope * FFT size); the firmware's own c is exactly 3.0e8.
  double range_step_m = 0;
  std::uint32_t antennas = 0;  // virtual: Rx enabled * Tx used by the frame's chirps
  double frame_period_s = 0;
  bool range_profile_on = false;  // guiMonitor sends TLV 2
  std::vector<std::string> warnings;
};

// Throws Error(config) as "NAME:LINE: ...": a command with too few numbers, one that is missing, a
// line longer than the firmware's buffer (255 characters, 40 words).
RadarProfile parse_profile(std::string_view cfg_text, const std::string& name);

// name "radar", quantity "log2_q8", unit "m", scale = antennas. Bin i stands at i * range_step_m:
// the firmware does not apply its range bias to the profile.
Axis radar_axis(const RadarProfile& profile);

// TLV 2 holds 256 * log2 of the magnitude, summed over the virtual antennas and divided by the next
// power of two of their number (SDK: DPIF_DETMATRIX_DATA_QFORMAT 8 and the CFAR threshold's dB
// conversion). So the mean over antennas of log2(magnitude) is code / 256 * 2^ceil(log2 n) / n, and
//   power = magnitude^2 = 2^(2 * code / 256 * 2^ceil(log2 n) / n),
// in an arbitrary unit: only ratios are physical. Frames are averaged in power, never in codes.
double power_from_code(double code, double antennas);
// The inverse; powers below 1 have no code and give 0.
double code_from_power(double power, double antennas);

}  // namespace echofuse::radar
