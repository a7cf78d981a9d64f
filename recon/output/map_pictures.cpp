// SPDX-License-Identifier: MIT
#include "recon/output/map_pictures.hpp"

#include <algorithm>
#include <cmath>

#include "acquire/record/png.hpp"
#include "drivers/core/exit_code.hpp"
#include "recon/files/text.hpp"

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

// What has the colour of the bar's end only because there is no other; the note says it.
void note_beyond(chart::Picture& p, const std::vector<double>& values, const std::string& below,
                 const std::string& above) {
  if (values.empty()) return;
  for (const double v : values) p.below += v<p.bar.first, p.above += v> p.bar.last;
  p.below /= static_cast<double>(values.size()), p.above /= static_cast<double>(values.size());
  std::string out;
  for (const auto& [share, words] : {std::pair{p.below, below}, {p.above, above}})
    if (share > 0)
      out += (out.empty() ? "" : ", ") +
             (share < 0.01 ? std::string("below 1 %") : formatted("%.0f %%", 100 * share)) + " " +
             words;
  if (!out.empty()) p.note += (p.note.empty() ? "" : " ") + out + ".";
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
  const std::vector<float> part = frame.cut(map);
  chart::Picture p =
      over_tangents(title, chart::depth_raster(part, frame.size, span.near, span.far), frame);
  p.bar = chart::depth_bar(span.near, span.far);
  p.marks = {frame.size};
  std::vector<double> depths;
  for (const float z : part) {
    p.marks.outlined.push_back(z > 0);
    if (z > 0) depths.push_back(double{z});
  }
  note_beyond(p, depths, "nearer than the scale", "farther");
  return p;
}

chart::Picture error_picture(std::span<const float> map, std::span<const float> truth,
                             const Frame& frame) {
  const std::vector<float> own = frame.cut(map), real = frame.cut(truth);
  chart::Picture p = over_tangents("Error: map minus truth",
                                   chart::error_raster(own, real, frame.size, most_error_m), frame);
  p.bar = chart::error_bar(most_error_m);
  p.marks = {frame.size};
  std::vector<double> errors;
  std::size_t missed = 0, invented = 0;
  for (std::size_t i = 0; i < own.size(); ++i) {
    const bool seen = own[i] > 0, there = real[i] > 0;
    p.marks.hatched.push_back(there && !seen), missed += there && !seen;
    p.marks.dotted.push_back(seen && !there), invented += seen && !there;
    if (seen && there) errors.push_back(double{own[i]} - double{real[i]});
  }
  if (missed + invented > 0)
    p.note = formatted("%zu of %zu pixels missed, %zu invented.", missed, missed + errors.size(),
                       invented);
  note_beyond(p, errors, formatted("nearer by more than %g m", most_error_m),
              "farther by more than that");
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
  const std::vector<float> part = frame.cut(deviation);
  chart::Picture p = over_tangents(
      "Stated uncertainty of a pixel's depth",
      chart::raster(part, frame.size, chart::ColourMap::spread, 0, most_deviation_m), frame);
  p.bar = {chart::ColourMap::spread, 0, most_deviation_m, "m"};
  note_beyond(p, {part.begin(), part.end()}, "", formatted("above %g m", most_deviation_m));
  return p;
}

}  // namespace echofuse::recon
