// SPDX-License-Identifier: MIT
#include "acquire/record/png.hpp"

#include <algorithm>
#include <iterator>
#include <opencv2/imgcodecs.hpp>

namespace echofuse::record {

Bytes encode_png16(std::span<const std::uint16_t> pixels, std::uint32_t width,
                   std::uint32_t height) {
  // OpenCV's Mat wants a non-const pointer but only reads here.
  const cv::Mat image(static_cast<int>(height), static_cast<int>(width), CV_16UC1,
                      const_cast<std::uint16_t*>(pixels.data()));
  Bytes png;
  try {
    // Level 1: on depth images the higher levels cost time and save nothing.
    if (cv::imencode(".png", image, png, {cv::IMWRITE_PNG_COMPRESSION, 1})) return png;
  } catch (const cv::Exception&) {  // it has limits of its own for the sides
  }
  return {};
}

namespace {

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

std::vector<std::uint16_t> decode_png16(ByteView png, std::uint32_t width, std::uint32_t height) {
  if (std::uint64_t{width} * height > max_png_pixels || !is_laid_out(png, width, height)) return {};
  const cv::Mat raw(1, static_cast<int>(png.size()), CV_8UC1,
                    const_cast<std::uint8_t*>(png.data()));
  const cv::Mat image = cv::imdecode(raw, cv::IMREAD_UNCHANGED);
  if (image.type() != CV_16UC1 || image.cols != static_cast<int>(width) ||
      image.rows != static_cast<int>(height))
    return {};
  return {image.begin<std::uint16_t>(), image.end<std::uint16_t>()};
}

}  // namespace echofuse::record
