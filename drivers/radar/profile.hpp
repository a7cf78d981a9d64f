// SPDX-License-Identifier: MIT
// Range axis and heat map that a TI mmWave .cfg file (SDK 3.x) produces.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/radar/board_antennas.hpp"

namespace echofuse::radar {

// Line to send. BOM and CR are removed, leading spaces kept. Blank lines and % comments are not
// included.
struct CfgLine {
  int number = 0;  // line number in the file, from 1
  std::string text;
};
std::vector<CfgLine> command_lines(std::string_view cfg_text);

struct RadarProfile {
  std::uint32_t adc_samples = 0;
  // Next power of two of adc_samples; 1022 for 1024 with 12 antennas (SDK, mss_main.c).
  std::uint32_t bins = 0;
  double range_step_m = 0;     // between bins (ramp.hpp)
  double resolution_m = 0;     // c / 2B of the sampled sweep
  std::uint32_t antennas = 0;  // virtual: Rx enabled * Tx used by the frame's chirps
  // Number of subframes, 1 to 4 (advFrameCfg), each sent as a separate packet. They differ only in
  // their start frequency.
  std::uint32_t subframes = 1;
  double frame_period_s = 0;  // period of the shortest subframe, s
  double active_s = 0;        // time per frame in which chirps are sent, s
  double carrier_hz = 0;      // centre of the sampled sweep
  // Frame size for the outputs enabled in guiMonitor, without detected points, rounded up to 32
  // bytes.
  std::uint32_t frame_bytes = 0;
  bool range_profile_on = false;  // guiMonitor sends TLV 2
  // Antennas of the heat map (TLV 4; on planar boards TLV 8), in its order; empty if not sent.
  std::vector<AntennaPlace> array;
  std::vector<AntennaPair> pairs;  // transmitter and receiver of each antenna
  bool planar = false;             // true: the heat map is TLV 8
  std::vector<std::string> warnings;
  // Reasons why a board would refuse the cfg, one line "NAME:LINE: ..." each. Not an error for a
  // recording of another board or SDK, because its axis is still defined.
  std::vector<std::string> refusals;
};

// Throws Error(config) with one line "NAME:LINE: ..." per fault:
//   a missing command, one with too few numbers, or one of another demo
//   a line that exceeds the firmware's buffer (255 characters, 40 words)
//   profiles in a frame or its subframes that differ in range axis or antennas
//   UTF-16, or line ends other than LF and CR LF
// `data_baud`: rate at which the data port will be read, for the warnings. `board` selects the
// antennas of the heat map, because one cfg runs on all boards.
RadarProfile parse_profile(std::string_view cfg_text, const std::string& name,
                           std::uint32_t data_baud = 921600, Board board = Board::isk);

// name "radar", quantity "log2_q8" (drivers/core/log2_codes.hpp), unit "m", scale = antennas. Bin i
// is at i * range_step_m, because the firmware does not apply its range bias to the profile.
Axis radar_axis(const RadarProfile& profile);
// name "array", quantity "covariance", the same bins, scale = antennas of the heat map.
Axis array_axis(const RadarProfile& profile);

}  // namespace echofuse::radar
