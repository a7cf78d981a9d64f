// SPDX-License-Identifier: MIT
// Checks the unit and the range of depth images while they are read.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/core/axis.hpp"

namespace echofuse::recon {

class DepthCheck {
 public:
  // Adds the depth image of one record. `mm`: depth of each pixel in millimetres; `far_m`: maximum
  // depth of the map, m.
  void add(std::span<const std::uint16_t> mm, double far_m);
  // Returns a warning if any depth exceeds the maximum of the map, or if the median depth is
  // outside the range of the histogram; otherwise returns an empty string. Throws Error(failed) if
  // the median depth is below 5 cm.
  std::string text(const std::string& path, const Axis& spd) const;

 private:
  double median_m() const;
  // Number of pixels deeper than `mm` millimetres.
  std::uint64_t farther_than(std::int64_t mm) const;
  // Four counters for each depth in millimetres; their sum is the number of pixels with that depth.
  std::array<std::array<std::uint64_t, 65536>, 4> counts_{};
  std::size_t records_ = 0, records_beyond_ = 0;
  double far_m_ = 0;
};

}  // namespace echofuse::recon
