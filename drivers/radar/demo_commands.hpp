// SPDX-License-Identifier: MIT
// Commands of TI's mmWave demo for xWR68xx and xWR64xx, SDK 3.4 to 3.6.
#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace echofuse::radar {

// Accepted values of an argument.
struct NumberRange {
  double min = 0, max = 0;
  bool whole = true;
  bool power_of_two = false;
  bool from_previous = false;  // true: the minimum is the previous argument
  bool hex = false;            // true: the number may be written as 0x...
};

struct DemoCommand {
  std::vector<NumberRange> numbers;
  // Commands that must come before this command, each with the value of its key if it has one.
  std::vector<std::string> after;
  // Argument (counted from 1) that selects the setting, e.g. the number of a profile; 0 for none.
  std::size_t key = 0;
  // Settings that sensorStart requires: the command's name, followed by the key if there are two.
  std::vector<std::string> needed;
  bool flushed = false;  // true: flushCfg deletes the setting
  // true: the first argument selects a subframe, or all of them with -1
  bool per_subframe = false;
};

// Returns the command, or nullptr if the demo does not have it.
const DemoCommand* demo_command(std::string_view name);
// Returns all settings that sensorStart requires, if dfeDataOutputMode is `mode`.
std::vector<std::string> needed_to_start(unsigned mode);

// Memory of the chip for the radar cube and the detection matrix (xWR6x43: 768 KiB of L3 RAM).
constexpr double radar_memory_bytes = 768 * 1024;
// Returns the memory that a frame needs. `loops`: number of chirps of each transmitter.
// Source: SDK, objdetrangehwa.c and objdetdsp (objectdetection.c).
double frame_memory_bytes(unsigned bins, unsigned antennas, unsigned loops);

}  // namespace echofuse::radar
