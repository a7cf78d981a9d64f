// SPDX-License-Identifier: MIT
// Depth maps as pictures, in the colours of the live page: near is bright, light grey is no return.
#pragma once
#include <span>

#include "drivers/core/bytes.hpp"
#include "recon/metrics/scene.hpp"

namespace echofuse::recon {

struct DepthSpan {
  double near = 2.5, far = 5;  // m
};
// Returns the depths of the training maps with a margin: one scale for all maps of a model.
DepthSpan span_of(const Scene& scene);

// Red, green and blue of each value of a map.
Bytes depth_colours(std::span<const float> map, const DepthSpan& span);

// Returns a PNG of a square map, row-major, metres. Each pixel is `zoom` x `zoom`; from 3 on a line
// surrounds what is there. Throws Error(failed) if it cannot be encoded.
Bytes depth_picture(std::span<const float> map, const DepthSpan& span, int zoom);

}  // namespace echofuse::recon
