// SPDX-License-Identifier: MIT
// How the radar's power varies within a record. Echoes that interfere (speckle) make it vary from
// frame to frame, as a body moves, and from one carrier to the next; the power of fully developed
// speckle is exponential, and varies by its mean (Goodman, Speckle Phenomena in Optics, 2007, 3.2).
// Noise alone hardly varies it. So both numbers tell how many independent looks there are. How fast
// it varies tells how fast a body moves, which a slot of a few looks shows better than how much.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace echofuse::record {

// With P(R, f, c) the power at range R in frame f at carrier c:
//   sum_R variance / sum_R mean^2
struct Speckle {
  double over_frames = 0;               // of the mean over the carriers
  std::optional<double> over_carriers;  // within a frame; none with one carrier
  // By how much more frames 150 ms apart differ than neighbouring ones, of half the
  // mean squared differences (von Neumann, Ann. Math. Stat. 12, 367, 1941); noise makes both alike.
  // None where no frames are so far apart.
  std::optional<double> over_150_ms = {};
  bool operator==(const Speckle&) const = default;
};

// Sums up frames, which come in order, their carriers in any. A frame that lacks a carrier is left
// out.
class SpeckleStatistics {
 public:
  explicit SpeckleStatistics(std::size_t carriers = 1) : carriers_(carriers) {}
  // Of equal length, linear.
  void add(std::uint64_t frame, std::size_t carrier, double time_s, std::span<const float> power);
  // Nothing of fewer than two frames, or without power.
  std::optional<Speckle> take() const;

 private:
  struct Frame {
    std::uint64_t number;
    double time_s;
    std::vector<double> power;  // mean over the carriers
  };
  std::optional<double> apart(std::uint64_t frames) const;
  std::optional<double> over_150_ms(double power) const;

  std::size_t carriers_;
  std::optional<std::uint64_t> frame_;
  std::uint64_t seen_ = 0;                 // carriers of this frame, by bits
  std::vector<double> now_, squares_now_;  // over this frame's carriers
  std::vector<Frame> frames_;              // that are whole
  double within_ = 0;                      // variances over carriers
};

}  // namespace echofuse::record
