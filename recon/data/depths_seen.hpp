// SPDX-License-Identifier: MIT
// Depth images as they are read tell whether their unit and the map's range are right.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/core/axis.hpp"

namespace echofuse::recon {

class DepthsSeen {
 public:
  // One record's image, millimetres, of a map that ends at far_m.
  void add(std::span<const std::uint16_t> mm, double far_m);
  // The line names records with depths beyond the range, and depths that the histogram cannot show.
  // Nothing is said of images without fault. Throws Error(failed) if the median is below 5 cm.
  std::string text(const std::string& path, const Axis& spd) const;

 private:
  double median_m() const;
  std::uint64_t farther_than(std::int64_t mm) const;  // returns
  // Pixels of each depth in millimetres, in four parts; not all without return.
  std::array<std::array<std::uint64_t, 65536>, 4> counts_{};
  std::size_t records_ = 0, records_beyond_ = 0;
  double far_m_ = 0;
};

}  // namespace echofuse::recon
