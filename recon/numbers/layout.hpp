// SPDX-License-Identifier: MIT
#pragma once
#include <algorithm>
#include <charconv>
#include <cstddef>
#include <string>

#include "drivers/core/axis.hpp"

namespace echofuse::recon {

// Returns how many lags of such an axis (data/lags.hpp) belong to vertical pairs of antennas; they
// come last. Read from the axis's quantity: "lags", or "lags, 3 up".
inline std::size_t lags_up(const Axis& lags) {
  const std::size_t comma = std::min(lags.quantity.find(", "), lags.quantity.size());
  std::size_t out = 0;
  std::from_chars(lags.quantity.data() + std::min(comma + 2, lags.quantity.size()),
                  lags.quantity.data() + lags.quantity.size(), out);
  return out;
}

// Columns of the inputs: the SPD's bins, then the radar's, then for each bin of its array c_0 and
// the real and imaginary parts of `scale` more lags (data/lags.hpp). The bins of the SPD's zones
// come last, zone after zone. A count of 0 means that the sensor is missing.
struct Layout {
  Axis spd, radar;
  Axis array = {};
  std::size_t zones = 0;
  std::size_t lag_values() const { return 2 * static_cast<std::size_t>(array.scale) + 1; }
  std::size_t lag_count() const { return array.count * lag_values(); }
  std::size_t zone_count() const { return zones * spd.count; }
  std::size_t inputs() const { return spd.count + radar.count + lag_count() + zone_count(); }
};

}  // namespace echofuse::recon
