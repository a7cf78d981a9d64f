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
  // Adds the depth image of one record. `mm`: pixels in millimetres; `far_m`: range of the map.
  void add(std::span<const std::uint16_t> mm, double far_m);
  // Returns a warning if depths exceed the range of the map, or the median depth is outside the
  // range of the histogram; otherwise empty. Throws Error(failed) if the median depth is below 5
  // cm.
  std::string text(const std::string& path, const Axis& spd) const;

 private:
  double median_m() const;
  std::uint64_t farther_than(std::int64_t mm) const;  // number of pixels with a depth above `mm`
  // Four counters for each depth in millimetres; their sum is the number of pixels.
  std::array<std::array<std::uint64_t, 65536>, 4> counts_{};
  std::size_t records_ = 0, records_beyond_ = 0;
  double far_m_ = 0;
};

}  // namespace echofuse::recon
