// SPDX-License-Identifier: MIT
// PNG: 16-bit grey, as files of maps have it, and pictures in colour.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

// Empty if it has more pixels than a depth image may have (record::max_depth_pixels).
Bytes encode_png16(std::span<const std::uint16_t> pixels, std::uint32_t width,
                   std::uint32_t height);
// Three bytes a pixel: red, green, blue. Empty if it cannot be done.
Bytes encode_png_rgb(std::span<const std::uint8_t> pixels, std::uint32_t width,
                     std::uint32_t height);
// Empty if the bytes are not a 16-bit grey PNG of this size as encode_png16 makes it, or larger
// than any.
std::vector<std::uint16_t> decode_png16(ByteView png, std::uint32_t width, std::uint32_t height);

}  // namespace echofuse::recon
