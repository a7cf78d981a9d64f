// SPDX-License-Identifier: MIT
// Depth maps as pictures: near is bright, light grey is no return (drivers/chart/colour_map.hpp).
#pragma once
#include <span>
#include <string>
#include <vector>

#include "drivers/chart/picture.hpp"
#include "recon/maps/scene.hpp"

namespace echofuse::recon {

// Throws Error(failed) if it cannot be encoded.
Bytes png_of(const chart::Raster& raster);

// What the training maps lie in, with room about it: one scale for all maps of a model.
chart::Span span_of(const Scene& scene);

chart::Raster enlarged(const chart::Raster& small, int by);

// A square map, row-major, metres; each pixel `zoom` x `zoom`, from 3 on with a line about what is
// there. PNG.
Bytes depth_picture(std::span<const float> map, const chart::Span& span, int zoom);

inline constexpr double most_error_m = 0.5;      // of a picture of errors, both ways
inline constexpr double most_deviation_m = 2.0;  // half of what a body stands out by

// The part of a square map that is shown: pixels, and the tangents at its edges.
struct Frame {
  std::size_t side = 0, left = 0, top = 0, size = 0;      // of the map; of the part
  double tangent_left = 0, tangent_top = 0, tangent = 0;  // tangent: of its width and height
  std::vector<float> cut(std::span<const float> map) const;
};
Frame whole_frame(std::size_t side, double half_tangent);
// A square about what the maps show, with room about it; the whole if that is most of it.
Frame frame_about(std::span<const float> a, std::span<const float> b, double half_tangent);

// With scales, what lies beyond them in words, and marks (chart::map_legend).
chart::Picture map_picture(const std::string& title, std::span<const float> map, const Frame& frame,
                           const chart::Span& span);
chart::Picture error_picture(std::span<const float> map, std::span<const float> truth,
                             const Frame& frame);
chart::Picture share_picture(const std::string& title, std::span<const float> share,
                             const Frame& frame);
chart::Picture deviation_picture(std::span<const float> deviation, const Frame& frame);

}  // namespace echofuse::recon
