// SPDX-License-Identifier: MIT
#include "acquire/record/png.hpp"

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

std::vector<std::uint16_t> decode_png16(ByteView png, std::uint32_t width, std::uint32_t height) {
  // The size is in the first chunk (PNG specification, IHDR): a damaged one must not allocate.
  const auto big_endian = [&](std::size_t at) {
    return std::uint32_t{png[at]} << 24 | std::uint32_t{png[at + 1]} << 16 |
           std::uint32_t{png[at + 2]} << 8 | std::uint32_t{png[at + 3]};
  };
  if (png.size() < 24 || big_endian(16) != width || big_endian(20) != height) return {};
  const cv::Mat raw(1, static_cast<int>(png.size()), CV_8UC1,
                    const_cast<std::uint8_t*>(png.data()));
  const cv::Mat image = cv::imdecode(raw, cv::IMREAD_UNCHANGED);
  if (image.type() != CV_16UC1 || image.cols != static_cast<int>(width) ||
      image.rows != static_cast<int>(height))
    return {};
  return {image.begin<std::uint16_t>(), image.end<std::uint16_t>()};
}

}  // namespace echofuse::record
