// SPDX-License-Identifier: MIT
#include "drivers/chart/colour_map.hpp"

#include <algorithm>
#include <cmath>

namespace echofuse::chart {
namespace {

// Eleven of matplotlib's 256 colours each (CC0), inferno with white as its end, and a map of two
// ends with even lightness.
constexpr std::array<std::uint32_t, 11> viridis{0x440154, 0x482475, 0x414487, 0x355f8d,
                                                0x2a788e, 0x21918c, 0x22a884, 0x44bf70,
                                                0x7ad151, 0xbddf26, 0xfde725},
    inferno{0x000004, 0x160b39, 0x420a68, 0x6a176e, 0x932667, 0xbc3754,
            0xdd513a, 0xf37819, 0xfca50a, 0xf6d746, 0xffffff},
    two_ends{0x08306b, 0x1c5a9c, 0x4585bf, 0x84b0d8, 0xc5d8ec, 0xf7f7f7,
             0xf5d5b8, 0xeaa96c, 0xd37b2c, 0xa95308, 0x6e3003};

constexpr Rgb rgb_of(std::uint32_t hex) {
  return {static_cast<std::uint8_t>(hex >> 16), static_cast<std::uint8_t>(hex >> 8),
          static_cast<std::uint8_t>(hex)};
}

void put(Raster& out, const Rgb& rgb) { out.rgb.insert(out.rgb.end(), rgb.begin(), rgb.end()); }

Raster empty_raster(std::size_t pixels, std::size_t columns) {
  Raster out{columns, pixels / std::max<std::size_t>(columns, 1), {}};
  out.rgb.reserve(3 * pixels);
  return out;
}

}  // namespace

Rgb colour_of(ColourMap map, double share) {
  const auto& table = map == ColourMap::spread         ? inferno
                      : map == ColourMap::signed_error ? two_ends
                                                       : viridis;
  double at = std::clamp(std::isnan(share) ? 0 : share, 0.0, 1.0);
  if (map == ColourMap::near || map == ColourMap::spread) at = 1 - at;
  at *= static_cast<double>(table.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(at), table.size() - 2);
  const Rgb a = rgb_of(table[i]), b = rgb_of(table[i + 1]);
  Rgb out{};
  for (std::size_t c = 0; c < 3; ++c)
    out[c] = static_cast<std::uint8_t>(
        std::lround(a[c] + (at - static_cast<double>(i)) * (b[c] - a[c])));
  return out;
}

Raster depth_raster(std::span<const float> map, std::size_t columns, double near_m, double far_m) {
  Raster out = empty_raster(map.size(), columns);
  for (const float z : map)
    put(out,
        z > 0 ? colour_of(ColourMap::near, (double{z} - near_m) / (far_m - near_m)) : no_return);
  return out;
}

Raster raster(std::span<const float> values, std::size_t columns, ColourMap map, double first,
              double last) {
  Raster out = empty_raster(values.size(), columns);
  for (const float v : values) put(out, colour_of(map, (double{v} - first) / (last - first)));
  return out;
}

Raster error_raster(std::span<const float> map, std::span<const float> truth, std::size_t columns,
                    double most_m) {
  Raster out = empty_raster(map.size(), columns);
  for (std::size_t i = 0; i < map.size(); ++i) {
    const bool seen = map[i] > 0, there = truth[i] > 0;
    put(out, seen && there ? colour_of(ColourMap::signed_error,
                                       0.5 + (double{map[i]} - double{truth[i]}) / (2 * most_m))
             : there       ? missed
             : seen        ? invented
                           : no_return);
  }
  return out;
}

Span span_of(std::span<const float> depths) {
  std::vector<float> there;
  for (const float z : depths)
    if (z > 0) there.push_back(z);
  if (there.size() < 50) return {};
  std::sort(there.begin(), there.end());
  const auto at = [&](double share) {
    return double{there[static_cast<std::size_t>(share * static_cast<double>(there.size() - 1))]};
  };
  const double near = std::floor(2 * at(0.02)) / 2, far = std::ceil(2 * at(0.98)) / 2;
  return {near, std::max(far, near + 1)};
}

}  // namespace echofuse::chart
