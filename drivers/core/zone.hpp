// SPDX-License-Identifier: MIT
// Zone of a detector: a part of its field of view that has a histogram of its own.
#pragma once
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace echofuse {

inline constexpr std::size_t most_zones = 64;

// Counts of a record are those of zone after zone, each on the axis spd. A detector that states no
// zones is a single pixel.
struct Zone {
  // Tangents of the centre (x to the right, y up) and of the full width; NaN: not known.
  double x = std::numeric_limits<double>::quiet_NaN(), y = x, width = x;
  double zero_ps = 0;  // two-way time of range 0

  bool has_direction() const { return std::isfinite(x); }
  // A tangent of 100 is 89.4 degrees off the axis.
  bool plausible() const {
    const bool unknown = std::isnan(x) && std::isnan(y) && std::isnan(width);
    return std::abs(zero_ps) <= 1e12 &&
           (unknown || (std::abs(x) <= 100 && std::abs(y) <= 100 && width > 0 && width <= 200));
  }
};

inline bool operator==(const Zone& a, const Zone& b) {
  const auto same = [](double one, double other) {
    return one == other || (std::isnan(one) && std::isnan(other));
  };
  return same(a.x, b.x) && same(a.y, b.y) && same(a.width, b.width) && a.zero_ps == b.zero_ps;
}

using Zones = std::vector<Zone>;
inline std::size_t histograms_of(const Zones& zones) { return zones.empty() ? 1 : zones.size(); }

// Counts of the bins over all zones. Time zeros are not applied.
template <class T>
std::vector<T> sum_of_zones(const std::vector<T>& counts, std::size_t bins) {
  std::vector<T> out(bins);
  for (std::size_t i = 0; i < counts.size() && bins > 0; ++i) out[i % bins] += counts[i];
  return out;
}

}  // namespace echofuse
