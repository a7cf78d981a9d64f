// SPDX-License-Identifier: MIT
// Zone of a detector: a part of its field of view with its own histogram.
#pragma once
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace echofuse {

inline constexpr std::size_t max_zones = 64;

// A record contains the counts of all bins of the first zone, then those of the second zone, and so
// on. A single pixel is a detector with one zone.
struct Zone {
  // Tangents of the zone's centre (x to the right, y up) and of its full width; NaN if unknown.
  double x = std::numeric_limits<double>::quiet_NaN(), y = x, width = x;
  double zero_ps = 0;  // two-way time that corresponds to range 0

  bool has_direction() const { return std::isfinite(x); }
  // Returns false if a value is out of range. The limit for tangents is 100, i.e. 89.4 degrees from
  // the optical axis.
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

// Returns true if both zones have the same field of view, or both are unknown. Tangents may differ
// by 0.01, because two boards of the same type may differ by this much, and widths by twice this.
inline bool same_view(const Zone& a, const Zone& b) {
  constexpr double tolerance = 0.01;
  return a.has_direction() == b.has_direction() &&
         (!a.has_direction() ||
          (std::abs(a.x - b.x) < tolerance && std::abs(a.y - b.y) < tolerance &&
           std::abs(a.width - b.width) < 2 * tolerance));
}

using Zones = std::vector<Zone>;
// Returns the zone of a single-pixel detector. Its direction is unknown.
inline Zones single_pixel() { return Zones(1); }

// Returns the counts in each bin, summed over all zones. Does not align the zones by zero_ps.
template <class T>
std::vector<T> sum_of_zones(const std::vector<T>& counts, std::size_t bins) {
  std::vector<T> out(bins);
  for (std::size_t i = 0; i < counts.size() && bins > 0; ++i) out[i % bins] += counts[i];
  return out;
}

}  // namespace echofuse
