// SPDX-License-Identifier: MIT
// Tables of numbers as coloured pixels, by maps that are even to the eye and in black and white.
#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::chart {

using Rgb = std::array<std::uint8_t, 3>;

// Viridis; near: the low end bright; level: the high end bright.
enum class ColourMap : std::uint8_t { near, level };

Rgb colour_of(ColourMap map, double share);  // share: within 0..1, or taken to its ends

inline constexpr Rgb no_return{232, 235, 239};

struct Raster {
  std::size_t columns = 0, rows = 0;
  Bytes rgb;
};
// Row-major; what is not above 0, or no number, is no return.
Raster depth_raster(std::span<const float> map, std::size_t columns, double near_m, double far_m);
// Every value counts.
Raster raster(std::span<const float> values, std::size_t columns, ColourMap map, double first,
              double last);

struct Span {
  double near = 2.5, far = 5;
};
// What 96 % of the returns lie in, to half a metre and 1 m at least; 2.5 to 5 m of few.
Span span_of(std::span<const float> depths);

}  // namespace echofuse::chart
