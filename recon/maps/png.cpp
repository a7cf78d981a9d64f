// SPDX-License-Identifier: MIT
#include "recon/maps/png.hpp"

#include <libdeflate.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <optional>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/deflate.hpp"

namespace echofuse::recon {
namespace {

void put_big_endian(Bytes& out, std::uint32_t v) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(v >> shift));
}

// Appends a chunk. `contents` begins with the type of the chunk.
void put_chunk(Bytes& out, ByteView contents) {
  put_big_endian(out, static_cast<std::uint32_t>(contents.size() - 4));
  out.insert(out.end(), contents.begin(), contents.end());
  put_big_endian(out, ::libdeflate_crc32(0, contents.data(), contents.size()));
}

// PNG specification, section 5.2
constexpr std::uint8_t signature[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
enum Colours : std::uint8_t { grey = 0, rgb = 2 };

// Returns a PNG; empty on failure. `rows`: pixel rows, each preceded by its filter type, 0.
Bytes encode(ByteView rows, std::uint32_t width, std::uint32_t height, std::uint8_t bits,
             Colours colours) {
  Bytes head = {'I', 'H', 'D', 'R'}, data = {'I', 'D', 'A', 'T'};
  put_big_endian(head, width);
  put_big_endian(head, height);
  head.insert(head.end(), {bits, colours, 0, 0, 0});
  const Bytes packed = record::deflated(rows, 1);
  if (packed.empty()) return {};
  data.insert(data.end(), packed.begin(), packed.end());
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

// Returns the compressed rows of a PNG in the layout of encode_png16: signature, IHDR of this size
// (16 bits, grey, not interlaced), IDAT chunks, and IEND. Returns an empty value if there are other
// chunks, because these could make a decoder allocate too much memory. Does not check the CRC of an
// IDAT, because the compressed rows have their own checksum.
std::optional<Bytes> compressed_rows(ByteView png, std::uint32_t width, std::uint32_t height) {
  constexpr std::uint8_t begin[] = {0, 0, 0, 13, 'I', 'H', 'D', 'R'};
  constexpr std::uint8_t kind[] = {16, 0, 0, 0, 0};
  // first_chunk: number of bytes before the first IDAT chunk. around_data: number of bytes that a
  // chunk contains in addition to its data (length, type and CRC).
  constexpr std::size_t first_chunk = 33, around_data = 12;
  if (png.size() < first_chunk ||
      !std::equal(std::begin(signature), std::end(signature), png.begin()) ||
      !std::equal(std::begin(begin), std::end(begin), png.begin() + sizeof signature) ||
      big_endian(png, 16) != width || big_endian(png, 20) != height ||
      !std::equal(std::begin(kind), std::end(kind), png.begin() + 24) ||
      ::libdeflate_crc32(0, png.data() + 12, 17) != big_endian(png, 29))
    return std::nullopt;
  Bytes data;
  for (ByteView rest = png.subspan(first_chunk); rest.size() >= around_data;) {
    const std::uint32_t length = big_endian(rest, 0), name = big_endian(rest, 4);
    constexpr std::uint32_t idat = 0x49444154, iend = 0x49454e44;  // "IDAT" and "IEND" in ASCII
    if (length > rest.size() - around_data) return std::nullopt;
    if (name == iend && rest.size() == around_data) return data;
    if (name != idat) return std::nullopt;
    data.insert(data.end(), rest.begin() + 8, rest.begin() + 8 + length);
    rest = rest.subspan(around_data + length);
  }
  return std::nullopt;
}

// Reverses the filter of a row of 16-bit pixels (PNG specification, section 9.2). `above`: the
// previous row, or zeros. Returns false if the filter type is unknown.
bool unfilter(std::uint8_t filter, std::span<std::uint8_t> row, ByteView above) {
  enum Filter : std::uint8_t { none, sub, up, average, paeth };
  if (filter > paeth) return false;
  if (filter == none) return true;
  for (std::size_t i = 0; i < row.size(); ++i) {
    const int a = i < 2 ? 0 : row[i - 2], b = above[i], c = i < 2 ? 0 : above[i - 2];
    const int to_a = std::abs(b - c), to_b = std::abs(a - c), to_c = std::abs(a + b - 2 * c);
    const int nearest = to_a <= to_b && to_a <= to_c ? a : to_b <= to_c ? b : c;
    const int guesses[] = {0, a, b, (a + b) / 2, nearest};
    row[i] = static_cast<std::uint8_t>(row[i] + guesses[filter]);
  }
  return true;
}

}  // namespace

Bytes encode_png16(std::span<const std::uint16_t> pixels, std::uint32_t width,
                   std::uint32_t height) {
  const std::uint64_t size = std::uint64_t{width} * height;
  if (size == 0 || size > record::max_depth_pixels || size != pixels.size()) return {};
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
  const std::size_t pixel_bytes = 2 * std::size_t{width};
  if (std::uint64_t{width} * height > record::max_depth_pixels) return {};
  const auto data = compressed_rows(png, width, height);
  if (!data) return {};
  Bytes rows = record::inflated(*data, height * (pixel_bytes + 1));
  if (rows.empty()) return {};
  std::vector<std::uint16_t> pixels(std::size_t{width} * height);
  const Bytes zeros(pixel_bytes);
  ByteView above = zeros;
  for (std::size_t y = 0; y < height; ++y) {
    const auto row = std::span(rows).subspan(y * (pixel_bytes + 1) + 1, pixel_bytes);
    if (!unfilter(rows[y * (pixel_bytes + 1)], row, above)) return {};
    above = row;
    std::uint16_t* const out = pixels.data() + y * width;
    for (std::size_t x = 0; x < width; ++x)
      out[x] = static_cast<std::uint16_t>(row[2 * x] << 8 | row[2 * x + 1]);
  }
  return pixels;
}

}  // namespace echofuse::recon
