// SPDX-License-Identifier: MIT
// Range axis and heat map that result from a TI mmWave .cfg file (SDK 3.x).
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/radar/board_antennas.hpp"

namespace echofuse {
struct RadarFrame;
}

namespace echofuse::radar {

// A line of the cfg that is sent to the radar. BOM and CR are removed, and leading spaces are kept.
// Blank lines and comments (%) are not included.
struct CfgLine {
  int number = 0;  // line number in the file, counted from 1
  std::string text;
};
std::vector<CfgLine> command_lines(std::string_view cfg_text);

struct RadarProfile {
  std::uint32_t adc_samples = 0;
  // Number of range bins: adc_samples rounded up to a power of two, but 1022 instead of 1024 if
  // there are 12 antennas (SDK, mss_main.c).
  std::uint32_t bins = 0;
  double range_step_m = 0;  // range difference between adjacent bins (ramp.hpp)
  // range resolution c / 2B, where B is the bandwidth of the sampled sweep
  double resolution_m = 0;
  // Number of virtual antennas: enabled receivers times transmitters used by the frame's chirps.
  std::uint32_t antennas = 0;
  // Number of subframes, 1 to 4 (advFrameCfg). Each subframe is sent as a separate packet.
  // Subframes may differ only in their start frequency.
  std::uint32_t subframes = 1;
  double frame_period_s = 0;               // mean time between packets, s
  std::vector<double> subframe_periods_s;  // time from each subframe to the next one
  double active_s = 0;                     // total duration of a frame's chirps, s
  double carrier_hz = 0;                   // centre frequency of the sampled sweep
  // Size of a frame with the outputs that guiMonitor enables, without detected points, rounded up
  // to a multiple of 32 bytes.
  std::uint32_t frame_bytes = 0;
  bool range_profile_on = false;  // true if guiMonitor enables TLV 2
  // Antenna positions of the heat map, in the order of its TLV (4, or 8 on planar boards). Empty if
  // the heat map is not enabled.
  std::vector<AntennaPlace> array;
  std::vector<AntennaPair> pairs;  // transmitter and receiver of each antenna
  bool planar = false;             // true: the heat map is sent as TLV 8; false: as TLV 4
  std::vector<std::string> warnings;
  // Reasons why a board would reject the cfg, each in the form "NAME:LINE: ...". They are not
  // errors if the cfg belongs to a recording made with another board or SDK, because the
  // recording's range axis is still defined.
  std::vector<std::string> refusals;
};

// Reads a cfg. Throws Error(config) with one line "NAME:LINE: ..." per fault:
//   - a missing command, a command of another demo, or a number that determines the range axis, the
//     antennas or the frame and is missing or outside its range (demo_commands.hpp)
//   - a line that exceeds the firmware's buffer (255 characters, 40 words)
//   - chirps of a frame that differ in profile, or enable several transmitters without BPM
//   - subframes that differ in range axis or antennas
//   - no command, or line endings other than LF and CR LF
// `data_baud`: rate at which the data port will be read, used for warnings. `board` selects the
// antennas of the heat map, because the cfg does not depend on the board.
RadarProfile parse_profile(std::string_view cfg_text, const std::string& name,
                           std::uint32_t data_baud = 921600, Board board = Board::isk);

// Returns the axis with name "radar", quantity "power_with_noise" (drivers/core/axis.hpp) and unit
// "m". Bin i is at range i * range_step_m, because the firmware does not apply its range bias to
// the profile.
Axis radar_axis(const RadarProfile& profile);
// Returns why the heat map of the frame does not match the profile; otherwise an empty string.
std::string heat_map_fault(const RadarProfile& profile, const RadarFrame& frame);

// Returns the axis with name "array", quantity "covariance" and the bins of radar_axis(). Its scale
// is the number of antennas in the heat map.
Axis array_axis(const RadarProfile& profile);

}  // namespace echofuse::radar
