// SPDX-License-Identifier: MIT
#include "drivers/chart/colour_map.hpp"

#include <algorithm>
#include <cmath>

namespace echofuse::chart {
namespace {

// Eleven of matplotlib's 256 colours (CC0).
constexpr std::array<std::uint32_t, 11> viridis{0x440154, 0x482475, 0x414487, 0x355f8d,
                                                0x2a788e, 0x21918c, 0x22a884, 0x44bf70,
                                                0x7ad151, 0xbddf26, 0xfde725};

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
  const auto& table = viridis;
  double at = std::clamp(std::isnan(share) ? 0 : share, 0.0, 1.0);
  if (map == ColourMap::near) at = 1 - at;
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
