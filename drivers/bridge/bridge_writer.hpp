// SPDX-License-Identifier: MIT
// The other direction of bridge_protocol.hpp, for what a run keeps of a camera that sends no bytes.
#pragma once
#include <cstdint>

#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/driver.hpp"

namespace echofuse::bridge {

// Header and payload.
Bytes make_block(BlockKind kind, std::uint32_t sequence, std::uint64_t dropped_items,
                 ByteView payload);
Bytes hello_payload(const DeviceInfo& info);
// With axes of the frame's width and height.
Bytes depth_payload(const DepthFrame& frame, const Axis& x, const Axis& y);

}  // namespace echofuse::bridge
