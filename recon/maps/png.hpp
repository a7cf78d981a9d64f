// SPDX-License-Identifier: MIT
// Reads and writes depth maps as 16-bit grey PNGs, and writes colour PNGs.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

// Returns the pixels as a 16-bit greyscale PNG; empty if it would have more pixels than a depth
// image may have (record::max_depth_pixels).
Bytes encode_png16(std::span<const std::uint16_t> pixels, std::uint32_t width,
                   std::uint32_t height);
// Returns a colour PNG from three bytes per pixel (red, green, blue); empty on failure.
Bytes encode_png_rgb(std::span<const std::uint8_t> pixels, std::uint32_t width,
                     std::uint32_t height);
// Returns the pixels of a PNG; empty unless it is a 16-bit grey PNG of this size in the layout of
// encode_png16.
std::vector<std::uint16_t> decode_png16(ByteView png, std::uint32_t width, std::uint32_t height);

}  // namespace echofuse::recon
