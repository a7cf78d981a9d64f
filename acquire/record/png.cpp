// SPDX-License-Identifier: MIT
#include "acquire/record/png.hpp"

#include <libdeflate.h>
#include <spng.h>

#include <algorithm>
#include <iterator>
#include <memory>

namespace echofuse::record {
namespace {

using Context = std::unique_ptr<spng_ctx, decltype([](spng_ctx* c) { spng_ctx_free(c); })>;

void put_big_endian(Bytes& out, std::uint32_t v) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(v >> shift));
}

// `contents` begins with the chunk's name.
void put_chunk(Bytes& out, ByteView contents) {
  put_big_endian(out, static_cast<std::uint32_t>(contents.size() - 4));
  out.insert(out.end(), contents.begin(), contents.end());
  put_big_endian(out, ::libdeflate_crc32(0, contents.data(), contents.size()));
}

constexpr std::uint8_t signature[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
enum Colours : std::uint8_t { grey = 0, rgb = 2 };

// `rows`: each begins with its filter, 0: on depth maps others cost time and save nothing, as does
// a level above 1.
Bytes encode(ByteView rows, std::uint32_t width, std::uint32_t height, std::uint8_t bits,
             Colours colours) {
  using Compressor =
      std::unique_ptr<libdeflate_compressor,
                      decltype([](libdeflate_compressor* c) { libdeflate_free_compressor(c); })>;
  thread_local const Compressor compressor(libdeflate_alloc_compressor(1));
  if (!compressor) return {};
  Bytes head = {'I', 'H', 'D', 'R'}, data = {'I', 'D', 'A', 'T'};
  put_big_endian(head, width);
  put_big_endian(head, height);
  head.insert(head.end(), {bits, colours, 0, 0, 0});
  data.resize(4 + libdeflate_zlib_compress_bound(compressor.get(), rows.size()));
  data.resize(4 + libdeflate_zlib_compress(compressor.get(), rows.data(), rows.size(),
                                           data.data() + 4, data.size() - 4));
  Bytes out(std::begin(signature), std::end(signature));
  put_chunk(out, head);
  put_chunk(out, data);
  put_chunk(out, Bytes{'I', 'E', 'N', 'D'});
  return out;
}

std::uint32_t big_endian(ByteView bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
         std::uint32_t{bytes[at + 2]} << 8 | std::uint32_t{bytes[at + 3]};
}

// Whether the bytes are laid out as encode_png16 does it: signature, IHDR of this size (16 bits,
// grey, not interlaced), IDATs, IEND. Of other chunks a decoder would make what they ask for.
bool is_laid_out(ByteView png, std::uint32_t width, std::uint32_t height) {
  constexpr std::uint8_t begin[] = {0, 0, 0, 13, 'I', 'H', 'D', 'R'};
  constexpr std::uint8_t kind[] = {16, 0, 0, 0, 0};
  constexpr std::size_t first_chunk = 33, around_data = 12;  // length, name, CRC
  if (png.size() < first_chunk ||
      !std::equal(std::begin(signature), std::end(signature), png.begin()) ||
      !std::equal(std::begin(begin), std::end(begin), png.begin() + sizeof signature) ||
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
  const std::uint64_t size = std::uint64_t{width} * height;
  if (size == 0 || size > max_png_pixels || size != pixels.size()) return {};
  Bytes rows;
  rows.reserve(std::size_t{height} * (2 * std::size_t{width} + 1));
  for (std::size_t y = 0; y < height; ++y) {
    rows.push_back(0);
    for (const std::uint16_t v : pixels.subspan(y * width, width)) {
      rows.push_back(static_cast<std::uint8_t>(v >> 8));
      rows.push_back(static_cast<std::uint8_t>(v));
    }
  }
  return encode(rows, width, height, 16, grey);
}

Bytes encode_png_rgb(std::span<const std::uint8_t> pixels, std::uint32_t width,
                     std::uint32_t height) {
  const std::size_t row = 3 * std::size_t{width};
  if (pixels.empty() || row * height != pixels.size()) return {};
  Bytes rows;
  rows.reserve(height * (row + 1));
  for (std::size_t y = 0; y < height; ++y) {
    const auto from = pixels.subspan(y * row, row);
    rows.push_back(0);
    rows.insert(rows.end(), from.begin(), from.end());
  }
  return encode(rows, width, height, 8, rgb);
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
