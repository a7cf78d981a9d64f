// SPDX-License-Identifier: MIT
#include "drivers/bridge/bridge_writer.hpp"

#include <nlohmann/json.hpp>
#include <string>

#include "drivers/core/crc32c.hpp"

namespace echofuse::bridge {

Bytes make_block(BlockKind kind, std::uint32_t sequence, std::uint64_t dropped_items,
                 ByteView payload) {
  Bytes block{'E', 'F', 'B', 'R'};
  block.reserve(header_bytes + payload.size());
  put(block, protocol_version);
  put(block, static_cast<std::uint16_t>(kind));
  put(block, sequence);
  put(block, static_cast<std::uint32_t>(payload.size()));
  put(block, dropped_items);
  put(block, std::uint32_t{0});
  put(block, crc32c(payload, crc32c(block)));
  block.insert(block.end(), payload.begin(), payload.end());
  return block;
}

Bytes hello_payload(const DeviceInfo& info) {
  const std::string text =
      nlohmann::json{{"model", info.model}, {"serial", info.serial}, {"firmware", info.firmware}}
          .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return {text.begin(), text.end()};
}

Bytes depth_payload(const DepthFrame& frame, const Axis& x, const Axis& y) {
  Bytes payload;
  put(payload, frame.width);
  put(payload, frame.height);
  put(payload, frame.device_time_us);
  put(payload, frame.frame_number);
  for (const double value : {x.start, x.step, y.start, y.step})
    put(payload, static_cast<float>(value));
  const ByteView pixels = as_bytes(frame.depth_mm);
  payload.insert(payload.end(), pixels.begin(), pixels.end());
  return payload;
}

}  // namespace echofuse::bridge
