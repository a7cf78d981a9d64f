// SPDX-License-Identifier: MIT
// Writes blocks of the bridge protocol for the raw capture of a camera that has no byte stream.
#pragma once
#include <cstdint>

#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/driver.hpp"

namespace echofuse::bridge {

Bytes make_block(BlockKind kind, std::uint32_t sequence, std::uint64_t dropped_items,
                 ByteView payload);
Bytes hello_payload(const DeviceInfo& info);
// The number of points must equal the frame's width on axis `x`, and its height on axis `y`.
Bytes depth_payload(const DepthFrame& frame, const Axis& x, const Axis& y);

}  // namespace echofuse::bridge
