// SPDX-License-Identifier: MIT
// Input: u8 kind, then the payload of a hello, of tags or of a depth frame.
#include <cmath>

#include "drivers/bridge/bridge_protocol.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::bridge;
using fuzz::require;

namespace {

void hello(ByteView payload) {
  const auto hello = read_hello(payload);
  Bytes longer(payload.begin(), payload.end());
  longer.push_back('x');
  const bool has_nul = std::ranges::find(payload, 0) != payload.end();  // the end for the library
  require(has_nul || !read_hello(longer), "nothing may follow the object");
  const auto begin = fuzz::text_of(payload).find('{');
  if (!hello) return;
  require(begin != std::string_view::npos, "a hello is an object");
  const std::size_t size = hello->model.size() + hello->serial.size() + hello->firmware.size();
  require(size <= payload.size(), "its texts come from the payload");
}

void tags(ByteView payload) {
  Bytes shifted{0};
  shifted.insert(shifted.end(), payload.begin(), payload.end());
  for (const ByteView bytes : {payload, ByteView(shifted).subspan(1)}) {
    std::vector<Tag> scratch;
    const auto read = read_tags(bytes, scratch);
    require(read.has_value() == (payload.size() % 16 == 0), "tags are whole or none");
    if (!read) continue;
    require(read->size() == payload.size() / 16, "all tags are there");
    const auto* first = reinterpret_cast<const std::uint8_t*>(read->data());
    require(std::equal(payload.begin(), payload.end(), first), "they are the payload's bytes");
  }
}

void depth(ByteView payload) {
  const auto read = read_depth(payload);
  ByteReader in(payload);
  const auto width = in.get<std::uint32_t>(), height = in.get<std::uint32_t>();
  const auto time = in.get<std::uint64_t>();
  const auto index = in.get<std::uint32_t>();
  float axes[4];
  for (float& value : axes) value = in.get<float>();
  // Fewer than 2^31 pixels, so the product cannot wrap to what is left.
  const bool fits = in.ok() && width && height && in.left() / 2 / width == height &&
                    in.left() == std::uint64_t{width} * height * 2;
  const auto lens = [&](std::size_t at, std::uint32_t count) {
    const double start = axes[at], step = axes[at + 1];
    return std::abs(start) <= 100 && std::abs(start + step * count) <= 100 &&
           std::abs(step) >= 1e-6 && count <= max_depth_side;
  };
  require(read.has_value() == (fits && lens(0, width) && lens(2, height)),
          "a frame is taken if its size and axes are right, and only then");
  if (!read) return;
  const DepthFrame& frame = read->frame;
  require(frame.width == width && frame.height == height && frame.device_time_us == time &&
              frame.frame_index == index && read->x.count == width && read->y.count == height,
          "the header's values are the frame's");
  require(std::ranges::equal(as_bytes(frame.depth_mm), in.take(in.left())), "so are the pixels");
}

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const ByteView payload = input.subspan(1);
  if (input[0] % 3 == 0) hello(payload);
  if (input[0] % 3 == 1) tags(payload);
  if (input[0] % 3 == 2) depth(payload);
}
