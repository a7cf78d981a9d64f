// SPDX-License-Identifier: MIT
#include "drivers/depth/bridge_camera.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace echofuse::depth {
namespace {

// value that some cameras report for pixels without a return
constexpr std::uint16_t invalid_mm = 65535;

}  // namespace

void BridgeCamera::on_block(const bridge::Block& block, HostTime received) {
  auto depth = bridge::read_depth(block.payload);
  if (block.kind != bridge::BlockKind::depth || !depth)
    return client_.reject(block, "depth frames", depth ? "" : depth.failure().what);
  announce({depth->x, depth->y});
  DepthFrame& frame = depth->frame;
  frame.received = received;
  std::ranges::replace(frame.depth_mm, invalid_mm, std::uint16_t{0});
  frame.lost_before = lost_before(frame.frame_number, block);
  ++items_;
  sink_->on_depth(std::move(frame));
}

}  // namespace echofuse::depth
