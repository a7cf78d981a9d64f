// SPDX-License-Identifier: MIT
#pragma once
#include <algorithm>
#include <charconv>
#include <cstddef>
#include <string>

#include "drivers/core/axis.hpp"

namespace echofuse::recon {

// Returns the number of lags of an axis (data/lags.hpp) that belong to vertical antenna pairs; they
// follow the horizontal ones. The number is part of the axis quantity: "lags" (none), or "lags, 3
// up".
inline std::size_t lags_up(const Axis& lags) {
  const std::size_t comma = std::min(lags.quantity.find(", "), lags.quantity.size());
  std::size_t out = 0;
  std::from_chars(lags.quantity.data() + std::min(comma + 2, lags.quantity.size()),
                  lags.quantity.data() + lags.quantity.size(), out);
  return out;
}

// Columns of the inputs of a model, in this order: SPD bins; radar bins; for each bin of the
// antenna axis, c_0 and the real and imaginary parts of `scale` further lags (data/lags.hpp); and
// bins of each SPD zone. An axis has count 0 if the sensor is missing.
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
