// SPDX-License-Identifier: MIT
// Depth maps as pictures: near is bright, grey is no return (drivers/chart/colour_map.hpp).
#pragma once
#include <span>
#include <string>

#include "drivers/chart/picture.hpp"
#include "recon/maps/scene.hpp"

namespace echofuse::recon {

// Throws Error(failed) if it cannot be encoded.
Bytes png_of(const chart::Raster& raster);

// What the training maps lie in, with room about it: one scale for all maps of a model.
chart::Span span_of(const Scene& scene);

// A square map, row-major, metres; each pixel `zoom` x `zoom`. PNG.
Bytes depth_picture(std::span<const float> map, const chart::Span& span, int zoom);

inline constexpr double most_error_m = 0.5;      // of a picture of errors, both ways
inline constexpr double most_deviation_m = 2.0;  // half of what a body stands out by

// With scales. Of maps over tangents of +-half_tangent.
chart::Picture map_picture(const std::string& title, std::span<const float> map,
                           double half_tangent, const chart::Span& span);
chart::Picture error_picture(std::span<const float> map, std::span<const float> truth,
                             double half_tangent);
chart::Picture deviation_picture(std::span<const float> deviation, double half_tangent);

}  // namespace echofuse::recon
