// SPDX-License-Identifier: MIT
// How the radar's power varies within a record. Echoes that interfere (speckle) make it vary from
// frame to frame, as a body moves, and from one carrier to the next; the power of fully developed
// speckle is exponential, and varies by its mean (Goodman, Speckle Phenomena in Optics, 2007, 3.2).
// Noise alone hardly varies it. So both numbers tell how many independent looks there are. How far
// it changes within a short time tells how fast a body moves, which a slot of a few looks shows
// better than how much it varies.
#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

namespace echofuse::record {

// With P(R, f, c) the power at range R in frame f at carrier c:
//   sum_R mean^2 variance / sum_R mean^4
// so that points which show noise alone, and how many there are, hardly matter.
struct Speckle {
  double over_frames = 0;               // variation of the mean over the carriers
  std::optional<double> over_carriers;  // within a frame; none with one carrier
  // Half the mean squared difference of frames 150 ms apart (von Neumann, Ann. Math. Stat. 12, 367,
  // 1941) in place of the variance: the less a body moves, the smaller. Noise adds to it. None
  // where no two frames are 140 to 250 ms apart.
  std::optional<double> over_150_ms = {};
  bool operator==(const Speckle&) const = default;
};

// Sums up frames, which come in order, their carriers in any. A frame that lacks a carrier is left
// out.
class SpeckleStatistics {
 public:
  explicit SpeckleStatistics(std::size_t carriers = 1) : carriers_(carriers) {}
  // Adds a profile: equal lengths, linear power. time_s: any clock; a frame has the time of its
  // last carrier.
  void add(std::uint64_t frame, std::size_t carrier, double time_s, std::span<const float> power);
  // Nothing of fewer than two frames, or without power.
  std::optional<Speckle> take() const;

 private:
  struct Frame {
    double time_s;
    std::vector<double> power;  // mean over the carriers
  };
  void compare(double time_s);

  std::size_t carriers_, frames_ = 0;
  std::optional<std::uint64_t> frame_;
  std::uint64_t seen_ = 0;                 // carriers of this frame, by bits
  std::vector<double> now_, squares_now_;  // over this frame's carriers
  std::vector<double> sum_, squares_;      // over frames, of their means
  std::vector<double> within_, apart_;     // variances over carriers; half the squared differences
  std::deque<Frame> recent_;               // frames that the next ones are compared with
  double pairs_ = 0;                       // number of frame pairs compared
};

}  // namespace echofuse::record
