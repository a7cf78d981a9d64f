// SPDX-License-Identifier: MIT
// Depth maps as pictures: near is bright, light grey is no return (drivers/chart/colour_map.hpp).
#pragma once
#include <span>

#include "drivers/chart/colour_map.hpp"
#include "recon/metrics/scene.hpp"

namespace echofuse::recon {

// What the training maps lie in, with room about it: one scale for all maps of a model.
chart::Span span_of(const Scene& scene);

// A square map, row-major, metres; each pixel `zoom` x `zoom`, from 3 on with a line about what is
// there. PNG; throws Error(failed) if it cannot be encoded.
Bytes depth_picture(std::span<const float> map, const chart::Span& span, int zoom);

}  // namespace echofuse::recon
