// SPDX-License-Identifier: MIT
// Times of the frames in a radar recording, fitted to the frame numbers and the board's clock.
//
// The clock has 32 bits and wraps every 21.47 s. All frames of a recording are considered together:
//   period  median clock step per frame number; the cfg's period if fewer than half of the steps
//           are within 5 % of the median
//   line    frames with clock readings that match their numbers and the period, across lost frames
// The longest line is valid, and each other line of at least 8 frames that does not overlap a
// longer one: the clock then continued after a gap of unknown length. The times of all other frames
// are impossible, and are computed from their numbers.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

struct FrameHeader {
  // `position` is the number of the subframe, counted from the start of frame 0.
  std::uint32_t position, number, cycles;
};

struct Irregularity {
  std::uint64_t count = 0;
  std::string places;  // positions of the first five occurrences in the recording
  void add(const std::string& place);
};

struct FrameTimes {
  std::vector<HostTime> at;  // time of each frame, relative to the first frame
  // Copies of frames: the same number and clock reading as an earlier frame.
  std::vector<bool> copy;
  Irregularity restarts, paused, impossible, stood;
  std::uint64_t copies = 0;
  double period_s = 0;  // measured time between positions; 0: not measured
};

// `period_s` is the cfg's time between positions. A frame has `subframes` positions.
FrameTimes fit_times(const std::vector<FrameHeader>& frames, std::uint32_t subframes,
                     double period_s);

}  // namespace echofuse::acquire
