// SPDX-License-Identifier: MIT
// Range axis and heat map that follow from a TI mmWave .cfg file (SDK 3.x), and the meaning of the
// profile's numbers.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/radar/antennas.hpp"

namespace echofuse::radar {

// A line to send: a mark of UTF-8 and the CR at the end stripped, leading spaces kept; blank lines
// and % comments are not among them.
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
  // From 1 to 4 (advFrameCfg), each with a packet of its own. They differ in their start frequency
  // alone.
  std::uint32_t subframes = 1;
  double frame_period_s = 0;  // s, shortest subframe
  double active_s = 0;        // s a frame in which chirps are sent
  double carrier_hz = 0;      // centre of the sampled sweep
  // Bytes a frame that guiMonitor asks for, without detected points, rounded up to 32.
  std::uint32_t frame_bytes = 0;
  bool range_profile_on = false;  // guiMonitor sends TLV 2
  // Antennas of the heat map (TLV 4, on planar boards 8), in its order; empty: not sent.
  std::vector<AntennaPlace> array;
  std::vector<AntennaPair> pairs;  // transmitter and receiver of each
  bool planar = false;             // true: the heat map is TLV 8
  std::vector<std::string> warnings;
  // Why a board will not take it, a line "NAME:LINE: ..." each. A recording of another board, or of
  // another SDK, has its axis all the same.
  std::vector<std::string> refusals;
};

// Throws Error(config) with a line "NAME:LINE: ..." for each fault: a command with too few numbers,
// one that is missing, a line longer than the firmware's buffer (255 characters, 40 words), one of
// another demo, profiles of a frame or its subframes without the same range axis and antennas, a
// text in UTF-16 or with other line ends than LF and CR LF.
// `data_baud` is the rate at which the data port will be read: the warnings need it. The board says
// which antennas a heat map has: the same cfg runs on all of them.
RadarProfile parse_profile(std::string_view cfg_text, const std::string& name,
                           std::uint32_t data_baud = 921600, Board board = Board::isk);

// name "radar", quantity "log2_q8" (drivers/core/log2_codes.hpp), unit "m", scale = antennas. Bin i
// stands at i * range_step_m: the firmware does not apply its range bias to the profile.
Axis radar_axis(const RadarProfile& profile);
// name "array", quantity "covariance", the same bins, scale = antennas of the heat map.
Axis array_axis(const RadarProfile& profile);

}  // namespace echofuse::radar
