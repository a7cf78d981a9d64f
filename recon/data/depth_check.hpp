// SPDX-License-Identifier: MIT
// Checks unit and range of depth images while they are read.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/core/axis.hpp"

namespace echofuse::recon {

class DepthCheck {
 public:
  // Adds one record's image, in millimetres, of a map with range far_m.
  void add(std::span<const std::uint16_t> mm, double far_m);
  // Returns a warning about depths beyond the range, or beyond the histogram's range; empty if
  // there are none. Throws Error(failed) if the median is below 5 cm.
  std::string text(const std::string& path, const Axis& spd) const;

 private:
  double median_m() const;
  std::uint64_t farther_than(std::int64_t mm) const;  // pixels with a return
  // Number of pixels at each depth in millimetres, in four parts.
  std::array<std::array<std::uint64_t, 65536>, 4> counts_{};
  std::size_t records_ = 0, records_beyond_ = 0;
  double far_m_ = 0;
};

}  // namespace echofuse::recon
