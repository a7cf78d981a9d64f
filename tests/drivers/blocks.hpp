// SPDX-License-Identifier: MIT
// Makes blocks of the bridge protocol like those in the golden file, for longer streams. Each block
// has one tag or one frame. The block number is the time of the tag or the index of the frame.
#pragma once
#include "drivers/bridge/bridge_writer.hpp"
#include "hex.hpp"

namespace echofuse::test {

inline ByteView payload_of(const Bytes& block) {
  return ByteView(block).subspan(bridge::header_bytes);
}

inline Bytes hello_block(const std::string& json = "{\"model\": \"test\"}") {
  return bridge::make_block(bridge::BlockKind::hello, 0, 0, view_of(json));
}

inline Bytes tags_block(std::uint32_t sequence, std::size_t tags = 1, std::uint64_t dropped = 0) {
  const std::vector<Tag> all(tags, {.channel = 1, .time_ps = sequence});
  return bridge::make_block(bridge::BlockKind::tags, sequence, dropped, as_bytes(all));
}

inline Bytes depth_block(std::uint32_t sequence, std::uint32_t index, std::uint64_t dropped = 0) {
  const DepthFrame frame{.device_time_us = index,
                         .frame_number = index,
                         .width = 2,
                         .height = 1,
                         .depth_mm = {1000, 2000}};
  return bridge::make_block(
      bridge::BlockKind::depth, sequence, dropped,
      bridge::depth_payload(frame, tangent_axis("x", 2, -0.5, 1), tangent_axis("y", 1, 0, -1)));
}

}  // namespace echofuse::test
