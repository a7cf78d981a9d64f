// SPDX-License-Identifier: MIT
#include "acquire/record/png.hpp"

#include <spng.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <memory>

namespace echofuse::record {
namespace {

using Context = std::unique_ptr<spng_ctx, decltype([](spng_ctx* c) { spng_ctx_free(c); })>;

Bytes encode(const void* pixels, std::size_t bytes, const spng_ihdr& header) {
  const Context context(spng_ctx_new(SPNG_CTX_ENCODER));
  spng_ihdr described = header;
  spng_set_option(context.get(), SPNG_ENCODE_TO_BUFFER, 1);
  // Level 1 without filters: on depth maps more costs time and saves nothing.
  spng_set_option(context.get(), SPNG_IMG_COMPRESSION_LEVEL, 1);
  spng_set_option(context.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_NONE);
  if (spng_set_ihdr(context.get(), &described) != 0 ||
      spng_encode_image(context.get(), pixels, bytes, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE) != 0)
    return {};
  std::size_t size = 0;
  int error = 0;
  const std::unique_ptr<void, decltype(&std::free)> png(
      spng_get_png_buffer(context.get(), &size, &error), &std::free);
  if (!png) return {};
  const auto* const first = static_cast<const std::uint8_t*>(png.get());
  return {first, first + size};
}

std::uint32_t big_endian(ByteView bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
         std::uint32_t{bytes[at + 2]} << 8 | std::uint32_t{bytes[at + 3]};
}

// Whether the bytes are laid out as encode_png16 does it: signature, IHDR of this size (16 bits,
// grey, not interlaced), IDATs, IEND. Of other chunks a decoder would make what they ask for.
bool is_laid_out(ByteView png, std::uint32_t width, std::uint32_t height) {
  constexpr std::uint8_t begin[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n',  //
                                    0,    0,   0,   13,  'I',  'H',  'D',  'R'};
  constexpr std::uint8_t kind[] = {16, 0, 0, 0, 0};
  constexpr std::size_t first_chunk = 33, around_data = 12;  // length, name, CRC
  if (png.size() < first_chunk || !std::equal(std::begin(begin), std::end(begin), png.begin()) ||
      big_endian(png, 16) != width || big_endian(png, 20) != height ||
      !std::equal(std::begin(kind), std::end(kind), png.begin() + 24))
    return false;
  std::size_t data = 0;
  for (ByteView rest = png.subspan(first_chunk); rest.size() >= around_data;) {
    const std::uint32_t length = big_endian(rest, 0), name = big_endian(rest, 4);
    constexpr std::uint32_t idat = 0x49444154, iend = 0x49454e44;
    if (length > rest.size() - around_data) return false;
    if (name == iend) {
      // Deflate makes at most 1032 bytes of one (zlib, "maximum compression factor").
      const std::uint64_t pixel_bytes = std::uint64_t{height} * (2 * std::uint64_t{width} + 1);
      return rest.size() == around_data && pixel_bytes <= 1032 * std::uint64_t{data};
    }
    if (name != idat) return false;
    data += length;
    rest = rest.subspan(around_data + length);
  }
  return false;
}

}  // namespace

Bytes encode_png16(std::span<const std::uint16_t> pixels, std::uint32_t width,
                   std::uint32_t height) {
  if (std::uint64_t{width} * height > max_png_pixels) return {};
  return encode(pixels.data(), pixels.size_bytes(),
                {width, height, 16, SPNG_COLOR_TYPE_GRAYSCALE, 0, 0, 0});
}

Bytes encode_png_rgb(std::span<const std::uint8_t> pixels, std::uint32_t width,
                     std::uint32_t height) {
  return encode(pixels.data(), pixels.size_bytes(),
                {width, height, 8, SPNG_COLOR_TYPE_TRUECOLOR, 0, 0, 0});
}

std::vector<std::uint16_t> decode_png16(ByteView png, std::uint32_t width, std::uint32_t height) {
  if (std::uint64_t{width} * height > max_png_pixels || !is_laid_out(png, width, height)) return {};
  const Context context(spng_ctx_new(0));
  std::vector<std::uint16_t> pixels(std::size_t{width} * height);
  if (spng_set_png_buffer(context.get(), png.data(), png.size()) != 0 ||
      spng_decode_image(context.get(), pixels.data(), pixels.size() * sizeof pixels[0],
                        SPNG_FMT_PNG, 0) != 0)
    return {};
  return pixels;
}

}  // namespace echofuse::record
