// SPDX-License-Identifier: MIT
// How the radar's power varies within a record. Echoes that interfere (speckle) make it vary from
// frame to frame, as a body moves, and from one carrier to the next; the power of fully developed
// speckle is exponential, and varies by its mean (Goodman, Speckle Phenomena in Optics, 2007, 3.2).
// Noise alone hardly varies it. So both numbers tell how many independent looks there are.
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
  bool operator==(const Speckle&) const = default;
};

// Sums up frames, which come in order, their carriers in any. A frame that lacks a carrier is left
// out.
class SpeckleStatistics {
 public:
  explicit SpeckleStatistics(std::size_t carriers = 1) : carriers_(carriers) {}
  // Of equal length, linear.
  void add(std::uint64_t frame, std::size_t carrier, std::span<const float> power);
  // Nothing of fewer than two frames, or without power.
  std::optional<Speckle> take() const;

 private:
  std::size_t carriers_, frames_ = 0;
  std::optional<std::uint64_t> frame_;
  std::uint64_t seen_ = 0;                 // carriers of this frame, by bits
  std::vector<double> now_, squares_now_;  // over this frame's carriers
  std::vector<double> sum_, squares_;      // over frames, of their means
  double within_ = 0;                      // variances over carriers
};

}  // namespace echofuse::record
