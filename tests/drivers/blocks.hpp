// SPDX-License-Identifier: MIT
// Makes blocks of the bridge protocol like those in the golden file, for longer streams. Each block
// has one tag or one frame. The block number is the time of the tag or the index of the frame.
#pragma once
#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/crc32c.hpp"
#include "hex.hpp"

namespace echofuse::test {

inline Bytes make_block(bridge::BlockKind kind, std::uint32_t sequence, ByteView payload,
                        std::uint64_t dropped = 0) {
  Bytes block;
  for (const char c : {'E', 'F', 'B', 'R'}) put(block, c);
  put(block, bridge::protocol_version);
  put(block, static_cast<std::uint16_t>(kind));
  put(block, sequence);
  put(block, static_cast<std::uint32_t>(payload.size()));
  put(block, dropped);
  put(block, std::uint32_t{0});
  put(block, crc32c(payload, crc32c(block)));
  block.insert(block.end(), payload.begin(), payload.end());
  return block;
}

inline Bytes hello_block(std::uint32_t sequence = 0) {
  return make_block(bridge::BlockKind::hello, sequence, view_of("{\"model\": \"test\"}"));
}

inline Bytes tags_block(std::uint32_t sequence) {
  Bytes payload;
  put(payload, Tag{.channel = 1, .time_ps = sequence});
  return make_block(bridge::BlockKind::tags, sequence, payload);
}

inline Bytes depth_block(std::uint32_t sequence, std::uint32_t index, std::uint64_t dropped = 0) {
  Bytes payload;
  for (const std::uint32_t size : {2u, 1u}) put(payload, size);
  put(payload, std::uint64_t{index});
  put(payload, index);
  for (const float axis : {-0.5f, 1.0f, 0.0f, -1.0f}) put(payload, axis);
  for (const int z : {1000, 2000}) put(payload, static_cast<std::uint16_t>(z));
  return make_block(bridge::BlockKind::depth, sequence, payload, dropped);
}

}  // namespace echofuse::test
