// SPDX-License-Identifier: MIT
// PNG: 16-bit grey depth maps, and colour pictures.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

// Empty if there are more pixels than allowed in a depth image (record::max_depth_pixels).
Bytes encode_png16(std::span<const std::uint16_t> pixels, std::uint32_t width,
                   std::uint32_t height);
// Three bytes per pixel: red, green, blue. Empty on failure.
Bytes encode_png_rgb(std::span<const std::uint8_t> pixels, std::uint32_t width,
                     std::uint32_t height);
// Empty unless the bytes are a 16-bit grey PNG of this size in the layout of encode_png16.
std::vector<std::uint16_t> decode_png16(ByteView png, std::uint32_t width, std::uint32_t height);

}  // namespace echofuse::recon
