// SPDX-License-Identifier: MIT
// Times of the frames in a radar recording, fitted to the frame numbers and the board's clock.
//
// The clock has 32 bits and wraps every 21.47 s. Neither a number nor a clock reading is trusted
// alone, and all frames of a recording are considered together:
//   chain   sequence of frames with increasing numbers in which the clock has advanced by the
//           difference of the numbers times the period. The number or the clock reading of a frame
//           between two members is damaged.
//   valid   the longest chain, each other chain of at least 8 frames that does not overlap a longer
//           one, and a shorter one that continues the chain before it or starts a new numbering
//   period  the cfg's, or the most frequent clock step per frame number if more frames then belong
//           to valid chains; then the median step within these chains
// The time of any other frame is computed from its number if this is between the numbers of its
// neighbours, else from its clock reading if this is between theirs, else it is one period after
// the previous frame. At an end of the recording, the clock may be at most 1.5 periods ahead.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

struct FrameHeader {
  // `position` is the number of the subframe, counted from the start of frame 0.
  std::uint32_t position, number, cycles;
  bool operator==(const FrameHeader&) const = default;
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
  std::vector<std::uint32_t> lost;  // number of frames missing before each member of a chain
  // `times` and `numbers`: frames with an impossible clock reading or number
  Irregularity restarts, paused, times, numbers, stopped;
  std::uint64_t copies = 0;
  double period_s = 0;      // measured time between positions; 0: not measured
  bool unnumbered = false;  // true: all frames have the same number and clock reading

  std::vector<std::string> doubts() const;  // warnings about damaged or missing frames
};

// `period_s` is the cfg's time between positions. A frame has `subframes` positions.
FrameTimes fit_times(const std::vector<FrameHeader>& frames, std::uint32_t subframes,
                     double period_s);

}  // namespace echofuse::acquire
