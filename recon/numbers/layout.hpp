// SPDX-License-Identifier: MIT
#pragma once
#include <cstddef>

#include "drivers/core/axis.hpp"

namespace echofuse::recon {

// Which columns of the inputs are what: the SPD's bins, then the radar's. A count of 0: not there.
struct Layout {
  Axis spd, radar;
  std::size_t inputs() const { return std::size_t{spd.count} + radar.count; }
};

}  // namespace echofuse::recon
