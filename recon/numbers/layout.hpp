// SPDX-License-Identifier: MIT
#pragma once
#include <cstddef>

#include "drivers/core/axis.hpp"

namespace echofuse::recon {

// Which columns of the inputs are what: the SPD's bins, then the radar's, then of each of its
// array's bins c_0 and real and imaginary part of `scale` more lags (data/lags.hpp). A count of 0:
// not there.
struct Layout {
  Axis spd, radar;
  Axis array = {};
  std::size_t lag_values() const { return 2 * static_cast<std::size_t>(array.scale) + 1; }
  std::size_t inputs() const {
    return std::size_t{spd.count} + radar.count + array.count * lag_values();
  }
};

}  // namespace echofuse::recon
