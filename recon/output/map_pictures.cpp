// SPDX-License-Identifier: MIT
#include "recon/output/map_pictures.hpp"

#include <algorithm>
#include <cmath>

#include "acquire/record/png.hpp"
#include "drivers/core/exit_code.hpp"

namespace echofuse::recon {
namespace {

std::size_t side_of(std::span<const float> map) {
  return static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(map.size()))));
}

chart::Raster enlarged(const chart::Raster& small, std::size_t zoom) {
  chart::Raster out{small.columns * zoom, small.rows * zoom, {}};
  out.rgb.reserve(3 * out.columns * out.rows);
  for (std::size_t y = 0; y < out.rows; ++y)
    for (std::size_t x = 0; x < out.columns; ++x) {
      const auto* pixel = &small.rgb[3 * (y / zoom * small.columns + x / zoom)];
      out.rgb.insert(out.rgb.end(), pixel, pixel + 3);
    }
  return out;
}

chart::Picture over_tangents(const std::string& title, const chart::Raster& raster,
                             double half_tangent) {
  chart::Picture p{title, png_of(raster)};
  p.left = p.bottom = -half_tangent, p.right = p.top = half_tangent;
  p.width = 380;
  return p;
}

}  // namespace

Bytes png_of(const chart::Raster& r) {
  Bytes out = record::encode_png_rgb(r.rgb, static_cast<std::uint32_t>(r.columns),
                                     static_cast<std::uint32_t>(r.rows));
  if (out.empty()) throw Error(ExitCode::failed, "cannot encode a PNG picture");
  return out;
}

chart::Span span_of(const Scene& scene) {
  const double body = double{scene.foreground_depth_m};
  const double wall = double{*std::max_element(scene.background.begin(), scene.background.end())};
  const double near = std::max(0.0, std::floor(2 * (body - 1)) / 2);
  const double far = std::ceil(2 * std::max(body + 1, wall)) / 2;
  return {near, std::clamp(far, near + 1, std::max(near + 1, record::max_depth_m))};
}

Bytes depth_picture(std::span<const float> map, const chart::Span& span, int zoom) {
  return png_of(enlarged(chart::depth_raster(map, side_of(map), span.near, span.far),
                         static_cast<std::size_t>(zoom)));
}

chart::Picture map_picture(const std::string& title, std::span<const float> map,
                           double half_tangent, const chart::Span& span) {
  chart::Picture p = over_tangents(
      title, chart::depth_raster(map, side_of(map), span.near, span.far), half_tangent);
  p.bar = chart::depth_bar(span.near, span.far);
  return p;
}

chart::Picture error_picture(std::span<const float> map, std::span<const float> truth,
                             double half_tangent) {
  chart::Picture p =
      over_tangents("Error: map minus truth",
                    chart::error_raster(map, truth, side_of(map), most_error_m), half_tangent);
  p.bar = chart::error_bar(most_error_m);
  return p;
}

chart::Picture deviation_picture(std::span<const float> deviation, double half_tangent) {
  chart::Picture p = over_tangents(
      "Its own uncertainty (standard deviation)",
      chart::raster(deviation, side_of(deviation), chart::ColourMap::spread, 0, most_deviation_m),
      half_tangent);
  p.bar = {chart::ColourMap::spread, 0, most_deviation_m, "m"};
  return p;
}

}  // namespace echofuse::recon
