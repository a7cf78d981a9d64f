// SPDX-License-Identifier: MIT
#include "recon/use/map_pictures.hpp"

#include <algorithm>
#include <cmath>

#include "acquire/record/png.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::recon {
namespace {

std::size_t side_of(std::span<const float> map) {
  return static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(map.size()))));
}

Bytes png_of(const chart::Raster& r) {
  Bytes out = record::encode_png_rgb(r.rgb, static_cast<std::uint32_t>(r.columns),
                                     static_cast<std::uint32_t>(r.rows));
  if (out.empty()) throw Error(ExitCode::failed, "cannot encode a PNG picture");
  return out;
}

chart::Raster enlarged(const chart::Raster& small, int by) {
  const auto zoom = static_cast<std::size_t>(by);
  chart::Raster out{small.columns * zoom, small.rows * zoom, {}};
  out.rgb.reserve(3 * out.columns * out.rows);
  for (std::size_t y = 0; y < out.rows; ++y)
    for (std::size_t x = 0; x < out.columns; ++x) {
      const auto* pixel = &small.rgb[3 * (y / zoom * small.columns + x / zoom)];
      out.rgb.insert(out.rgb.end(), pixel, pixel + 3);
    }
  return out;
}

}  // namespace

chart::Span span_of(const Scene& scene) {
  const double body = double{scene.foreground_depth_m};
  const double wall = double{*std::max_element(scene.background.begin(), scene.background.end())};
  const double near = std::max(0.0, std::floor(2 * (body - 1)) / 2);
  const double far = std::ceil(2 * std::max(body + 1, wall)) / 2;
  return {near, std::clamp(far, near + 1, std::max(near + 1, record::max_depth_m))};
}

Bytes depth_picture(std::span<const float> map, const chart::Span& span, int zoom) {
  constexpr chart::Rgb line{60, 65, 72};
  const std::size_t side = side_of(map), z = static_cast<std::size_t>(zoom);
  chart::Raster out = enlarged(chart::depth_raster(map, side, span.near, span.far), zoom);
  const auto there = [&](std::size_t x, std::size_t y) { return map[y / z * side + x / z] > 0; };
  for (std::size_t y = 1; z >= 3 && y + 1 < out.rows; ++y)
    for (std::size_t x = 1; x + 1 < out.columns; ++x)
      if (!there(x, y) &&
          (there(x - 1, y) || there(x + 1, y) || there(x, y - 1) || there(x, y + 1)))
        std::copy(line.begin(), line.end(), &out.rgb[3 * (y * out.columns + x)]);
  return png_of(out);
}

}  // namespace echofuse::recon
