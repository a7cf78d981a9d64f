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

chart::Picture over_tangents(const std::string& title, const chart::Raster& raster,
                             const Frame& f) {
  chart::Picture p{title, png_of(raster)};
  p.left = f.tangent_left, p.right = f.tangent_left + f.tangent;
  p.top = f.tangent_top, p.bottom = f.tangent_top - f.tangent;
  p.width = 370;
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

Bytes depth_picture(std::span<const float> map, const chart::Span& span, int zoom) {
  return png_of(enlarged(chart::depth_raster(map, side_of(map), span.near, span.far), zoom));
}

std::vector<float> Frame::cut(std::span<const float> map) const {
  std::vector<float> out;
  out.reserve(size * size);
  for (std::size_t y = top; y < top + size; ++y)
    for (std::size_t x = left; x < left + size; ++x) out.push_back(map[y * side + x]);
  return out;
}

Frame whole_frame(std::size_t side, double half_tangent) {
  return {side, 0, 0, side, -half_tangent, half_tangent, 2 * half_tangent};
}

Frame frame_about(std::span<const float> a, std::span<const float> b, double half_tangent) {
  const std::size_t side = side_of(a), room = side / 12;
  std::size_t first_x = side, last_x = 0, first_y = side, last_y = 0;
  for (std::size_t p = 0; p < a.size(); ++p) {
    if (!(a[p] > 0) && !(b[p] > 0)) continue;
    first_x = std::min(first_x, p % side), last_x = std::max(last_x, p % side);
    first_y = std::min(first_y, p / side), last_y = std::max(last_y, p / side);
  }
  Frame out = whole_frame(side, half_tangent);
  if (first_x > last_x) return out;
  const std::size_t size = std::max(last_x - first_x, last_y - first_y) + 1 + 2 * room;
  if (size > side * 4 / 5) return out;
  // Its middle as near to the maps' as the edges allow.
  const auto place = [&](std::size_t first, std::size_t last) {
    const std::size_t middle = (first + last + 1) / 2;
    return std::min(middle - std::min(middle, size / 2), side - size);
  };
  out.left = place(first_x, last_x), out.top = place(first_y, last_y), out.size = size;
  const double pixel = 2 * half_tangent / static_cast<double>(side);
  out.tangent_left += pixel * static_cast<double>(out.left);
  out.tangent_top -= pixel * static_cast<double>(out.top);
  out.tangent = pixel * static_cast<double>(size);
  return out;
}

chart::Picture map_picture(const std::string& title, std::span<const float> map, const Frame& frame,
                           const chart::Span& span) {
  chart::Picture p = over_tangents(
      title, chart::depth_raster(frame.cut(map), frame.size, span.near, span.far), frame);
  p.bar = chart::depth_bar(span.near, span.far);
  return p;
}

chart::Picture error_picture(std::span<const float> map, std::span<const float> truth,
                             const Frame& frame) {
  chart::Picture p = over_tangents(
      "Error: map minus truth",
      chart::error_raster(frame.cut(map), frame.cut(truth), frame.size, most_error_m), frame);
  p.bar = chart::error_bar(most_error_m);
  return p;
}

chart::Picture share_picture(const std::string& title, std::span<const float> share,
                             const Frame& frame) {
  chart::Picture p = over_tangents(
      title, chart::raster(frame.cut(share), frame.size, chart::ColourMap::spread, 0, 1), frame);
  p.bar = {chart::ColourMap::spread, 0, 1, ""};
  return p;
}

chart::Picture deviation_picture(std::span<const float> deviation, const Frame& frame) {
  chart::Picture p = over_tangents("Its own uncertainty (standard deviation)",
                                   chart::raster(frame.cut(deviation), frame.size,
                                                 chart::ColourMap::spread, 0, most_deviation_m),
                                   frame);
  p.bar = {chart::ColourMap::spread, 0, most_deviation_m, "m"};
  return p;
}

}  // namespace echofuse::recon
