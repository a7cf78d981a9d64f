// SPDX-License-Identifier: MIT
// Writes blocks of bridge_protocol.hpp, for raw capture of a camera without a byte stream.
#pragma once
#include <cstdint>

#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/driver.hpp"

namespace echofuse::bridge {

// Returns header and payload.
Bytes make_block(BlockKind kind, std::uint32_t sequence, std::uint64_t dropped_items,
                 ByteView payload);
Bytes hello_payload(const DeviceInfo& info);
// Axes must have the frame's width and height.
Bytes depth_payload(const DepthFrame& frame, const Axis& x, const Axis& y);

}  // namespace echofuse::bridge
